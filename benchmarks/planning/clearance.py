"""Preferred clearance on MotionBenchMaker's problems: ``python -m benchmarks.planning.clearance``.

    python -m benchmarks.planning.clearance ../data/mbm/panda [--every 5] [--preferred 0.02]

Plans each problem with and without the preferred clearance and prints the time integral of the
distance that lacks to it, the time of the motions and the computing time, by kind of scene.
Distances are looked at every 5 ms, from obstacles alone.
"""

import argparse
import time
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.mbm_problems import cases, panda
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import Problem
from planning.result import Failure
from planning.values.preferences import PreferredClearance

#: Between two looks at a motion [s].
PERIOD = 5e-3
#: Plans of one problem, the quickest of which counts.
REPEATS = 3


class Result(NamedTuple):
    """One plan: computing time [ms], duration [s] and integral of what lacks [mm s]."""

    milliseconds: float
    duration: float
    lacking: float


def lacking(problem: Problem, motion: Trajectory, preferred: float) -> float:
    """Time integral of the distance that lacks to the preferred one [mm s]."""
    checker, total = Checker.of(problem.robot, problem.scene), 0.0
    times = np.linspace(0.0, motion.duration, int(motion.duration / PERIOD) + 2)
    for q in motion.sample(times):
        near = checker.gradient(q, preferred)
        around = [
            d
            for pair, d in zip(near.pairs, near.distances, strict=True)
            if checker.model.pair_name(int(pair))[1] in problem.scene.ids
        ]
        total += max(preferred - min(around, default=preferred), 0.0)
    return 1e3 * total * motion.duration / len(times)


def result(problem: Problem, clearance: float, preferred: float) -> Result | None:
    """The plan of a problem that prefers ``clearance``; None where there is none."""
    options, quickest = Options(clearance=PreferredClearance(clearance)), np.inf
    for _ in range(REPEATS):
        began = time.process_time()
        answer = plan(problem, options)
        quickest = min(quickest, 1e3 * (time.process_time() - began))
    if isinstance(answer, Failure):
        return None
    short = lacking(problem, answer.trajectory, preferred)
    return Result(quickest, answer.trajectory.duration, short)


def report(kind: str, pairs: list[tuple[Result, Result]]) -> None:
    """Print one row."""
    values = np.array(pairs)
    off, on = values[:, 0].sum(axis=0), values[:, 1].sum(axis=0)
    middle = np.median(values, axis=0)
    print(
        f"{kind:24} {len(pairs):4d} | {middle[0, 0]:5.1f} {middle[1, 0]:5.1f} ms"
        f" ({on[0] / off[0] - 1.0:+.0%} of the sum) | {off[1]:7.2f} {on[1]:7.2f} s"
        f" ({on[1] / off[1] - 1.0:+.1%}) | {off[2]:7.1f} {on[2]:7.1f} mm s"
    )


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("--every", type=int, default=5, help="take every n-th problem of a kind")
    parser.add_argument("--preferred", type=float, default=0.02, help="[m]")
    asked = parser.parse_args()
    kinds: defaultdict[str, list[tuple[Result, Result]]] = defaultdict(list)
    robot = panda(asked.problems.parent.parent / "panda")
    for case in cases(asked.problems, robot.chain.joint_names, asked.every):
        problem = case.problem(robot, 0.0)
        off, on = (result(problem, c, asked.preferred) for c in (0.0, asked.preferred))
        if off is None or on is None:
            print(f"{case.name}: no plan {'without' if off is None else 'with'} the clearance")
            continue
        kinds[case.kind].append((off, on))
    for kind, pairs in sorted(kinds.items()):
        report(kind, pairs)
    report("all", [pair for pairs in kinds.values() for pair in pairs])


if __name__ == "__main__":
    main()
