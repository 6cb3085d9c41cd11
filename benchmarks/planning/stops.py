"""MotionBenchMaker problems for the Panda with provable stops: how many are slowed, by how much?

    python -m benchmarks.planning.stops ../data/mbm/panda [--every 10]

Reads the problems as ``benchmarks.mbm`` does. Joints brake with the data sheet's accelerations
and a jerk of a hundred of them a second.
"""

import argparse
from pathlib import Path

import numpy as np

from benchmarks.mbm_problems import ACCELERATION, cases, panda
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.result import Plan

#: Limit of the jerk in accelerations a second [1/s].
JERK = 100.0


def main() -> None:
    """Plan each problem with stops and print what they cost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--every", type=int, default=10)
    given = parser.parse_args()
    robot = panda(given.folder.parents[1] / "panda")
    limits = {"jerk": JERK * np.array(ACCELERATION)}
    options = Options(stops="joints", timeout=20.0, limits=limits)
    factors, seconds, milliseconds, refused = [], [], [], 0
    for case in cases(given.folder, robot.chain.joint_names, given.every):
        answer = plan(case.problem(robot, 0.0), options)
        if not isinstance(answer, Plan):
            refused += 1
            print(f"{case.name}: {answer.message}")
            continue
        assert answer.stops is not None
        duration, slowed = answer.trajectory.duration, answer.stops.slowed
        factors.append(duration / (duration - slowed))
        seconds.append(slowed)
        milliseconds.append(answer.stages[-1].milliseconds)
    costs = np.array(seconds)[np.array(seconds) > 0.0]
    print(f"{len(seconds)} plans, {refused} refused, {len(costs)} slowed down")
    if len(costs):
        print(f"slowed down by {np.median(costs):.2f} s at the median, {costs.max():.2f} s at most")
        print(f"largest factor {max(factors):.2f}")
    print(
        "stage stops [ms], median, p90, max:", np.percentile(milliseconds, [50, 90, 100]).round(1)
    )


if __name__ == "__main__":
    main()
