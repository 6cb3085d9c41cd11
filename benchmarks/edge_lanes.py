"""Straight motions proved with eight stretches abreast first, beside whole motions first.

    python -m benchmarks.edge_lanes --robots ur5 kinova g1_left --lengths 0.5 2

Arms of example-robot-data and the built-in Panda among solids, between configurations that are free
in the hulls of their links: motions that are free all along, and those that meet something. Told
are processor times of a motion in a loop inside a kernel, in turns, the least of a few rounds; and
how many verdicts differ.
"""

import argparse
import time
from typing import Any

import numpy as np

from benchmarks.example_arms import ARMS
from benchmarks.mesh_scenes import own_scenes
from benchmarks.meshes import reach
from benchmarks.scale import panda
from kinematics.arrays import Array
from kinematics.compiled.kernel import kernel
from obstacles.checker import Checker
from obstacles.edge_check import FREE, MAX_INTERVALS
from obstacles.kernel_work import workspace
from obstacles.line_check import certify_line, prove_line
from obstacles.model_arrays import ModelArrays

MOTIONS, TRIES, ROUNDS = 60, 4000, 5


@kernel
def whole_first(model: ModelArrays, starts: Array, ends: Array, verdicts: Array) -> None:
    """``certify_line`` of motions (k, n)."""
    work, found = workspace(model), np.empty(4)
    for k in range(starts.shape[0]):
        verdicts[k] = certify_line(model, work, starts[k], ends[k], 0.0, MAX_INTERVALS, found)


@kernel
def stretches_first(model: ModelArrays, starts: Array, ends: Array, verdicts: Array) -> None:
    """``prove_line`` of motions (k, n)."""
    work, found = workspace(model), np.empty(4)
    for k in range(starts.shape[0]):
        verdicts[k] = prove_line(model, work, starts[k], ends[k], 0.0, MAX_INTERVALS, found)


def motions(checker: Checker, length: float, random: np.random.Generator) -> tuple[Array, Array]:
    """Starts and ends (k, n), both free."""
    low, high = checker.model.chain.sampling_bounds()
    low, high = np.maximum(low, -np.pi), np.minimum(high, np.pi)
    starts = random.uniform(low, high, (TRIES, len(low)))
    steps = random.normal(size=starts.shape)
    ends = np.clip(starts + length * steps / np.linalg.norm(steps, axis=1)[:, None], low, high)
    free = checker.each_valid(starts) & checker.each_valid(ends)
    return starts[free][:MOTIONS], ends[free][:MOTIONS]


def seconds(run: Any, model: ModelArrays, starts: Array, ends: Array) -> float:
    """Processor time of a motion [s]."""
    verdicts = np.empty(len(starts))
    began = time.process_time()
    run(model, starts, ends, verdicts)
    return (time.process_time() - began) / len(starts)


def measure(name: str, scenes: int, length: float) -> str:
    """One row."""
    robot = panda() if name == "panda" else ARMS[name].geometry({"acceleration": 10.0})
    random, differ = np.random.default_rng(0), 0
    times: dict[bool, list[tuple[float, float]]] = {True: [], False: []}
    for scene in own_scenes(scenes, reach(robot)):
        checker = Checker.of(robot, scene)
        model = checker.model.arrays
        starts, ends = motions(checker, length, random)
        verdicts = np.empty((2, len(starts)))
        whole_first(model, starts, ends, verdicts[0])
        stretches_first(model, starts, ends, verdicts[1])
        differ += int((verdicts[0] != verdicts[1]).sum())
        for free, spent in times.items():
            chosen = (verdicts[0] == FREE) == free
            if chosen.any():
                rounds = [
                    [seconds(run, model, starts[chosen], ends[chosen]) for _ in range(2)]
                    for run in (whole_first, stretches_first) * ROUNDS
                ]
                least = [min(min(r) for r in rounds[side::2]) for side in range(2)]
                spent.append((least[0], least[1]))
    row = f"{name:12} {length:5.2f} rad"
    for free, spent in times.items():
        before, after = 1e6 * np.median(np.array(spent or [(np.nan, np.nan)]), axis=0)
        row += (
            f"  {'free' if free else 'blocked'} {before:7.1f} {after:7.1f} us {after / before:5.2f}"
        )
    return f"{row}  {differ} verdicts differ"


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=6)
    parser.add_argument("--lengths", type=float, nargs="+", default=[0.5, 2.0], help="[rad or m]")
    parser.add_argument("--robots", nargs="+", default=["panda"], choices=["panda", *ARMS])
    given = parser.parse_args()
    for name in given.robots:
        for length in given.lengths:
            print(measure(name, given.scenes, length), flush=True)


if __name__ == "__main__":
    main()
