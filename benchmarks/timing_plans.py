"""Every way of timing on all planned paths of MotionBenchMaker problems, judged by numpy alone.

    python -m benchmarks.timing_plans ../data/mbm/panda [--every 1]

Each problem is planned once for each method, with the manufacturer's velocity, acceleration and
jerk limits. What is counted: how many are solved, limit ratios above 1 + 1e-9, durations, stops.
"""

import argparse
import statistics
import time
from pathlib import Path

import numpy as np

from benchmarks.mbm_problems import ACCELERATION, cases, panda
from benchmarks.ratios import worst_ratio
from planning.options import Options
from planning.pipeline import plan
from planning.result import Failure
from planning.timing.options import METHODS, TimingOptions

#: Of the data sheet [rad/s^3].
JERK = (7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0)


def main() -> None:
    """Print a row a method."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("--every", type=int, default=1, help="take every n-th problem of a kind")
    asked = parser.parse_args()
    robot = panda(asked.problems.parent.parent / "panda")
    velocity = robot.chain.limits.velocity
    limits = {"acceleration": np.array(ACCELERATION), "jerk": np.array(JERK)}
    print("method        solved  over  worst ratio  motion s  timing ms med   max  attempts")
    for method in METHODS:
        solved, over, worst = 0, 0, 0.0
        durations, spent, attempts = [], [], []
        began = time.perf_counter()
        for case in cases(asked.problems, robot.chain.joint_names, asked.every):
            problem = case.problem(robot, 0.0)
            options = Options(timing=TimingOptions(method), limits=limits, timeout=10.0)
            answer = plan(problem, options)
            if isinstance(answer, Failure):
                continue
            solved += 1
            judged = {1: velocity, 2: limits["acceleration"]}
            if method == "jerk_limited":
                judged[3] = limits["jerk"]
            ratio = max(worst_ratio(answer.trajectory, v, k) for k, v in judged.items())
            worst, over = max(worst, ratio), over + (ratio > 1.0 + 1e-9)
            durations.append(answer.trajectory.duration)
            timings = [stage.milliseconds for stage in answer.stages if stage.name == "timing"]
            spent.append(sum(timings))
            attempts.append(len(timings))
        print(
            f"{method:14}{solved:6}{over:6}{worst:13.9f}{statistics.median(durations):10.3f}"
            f"{statistics.median(spent):15.1f}{max(spent):6.0f}  {max(attempts)} at most"
            f"   ({time.perf_counter() - began:.0f} s)",
            flush=True,
        )


if __name__ == "__main__":
    main()
