"""How often motions come nearer than preferred in scenes of many kinds although there is room.

    python -m benchmarks.clearance_room [--arm panda --arm ur5e] [--count 6] [--seed 0]

Scenes and ends of motions are drawn at random; ends keep the preferred clearance. There is room
where a motion is found with the preferred clearance as the margin, which is proved. Motions are
looked at every millisecond.
"""

import argparse
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from armwright.robot import load_robot
from kinematics.arrays import Array
from kinematics.pose import transform
from kinematics.trajectory import Trajectory
from obstacles.checker import Checker
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Obstacle, Scene
from obstacles.shapes import Box, Cylinder, Sphere
from planning.options import Options
from planning.pipeline import plan
from planning.preferred_clearance import PreferredClearance
from planning.problem import JointGoal, Problem
from planning.result import Plan

ARMS = ("panda", "ur5e", "kr6_sixx", "iiwa14")
PREFERRED = (0.01, 0.02, 0.05)
#: Between two looks at a motion [s].
PERIOD = 1e-3
#: What computing may round off [m].
ROUNDING = 1e-6


class Case(NamedTuple):
    """A problem, with what it is called."""

    kind: str
    arm: str
    preferred: float
    problem: Problem


class Result(NamedTuple):
    """A motion: processor time [ms], duration [s], how much it comes too near at most [m]."""

    milliseconds: float
    duration: float
    lacking: float
    time_below: float


def _post(random: np.random.Generator, reach: float) -> list[Obstacle]:
    angle, distance = random.uniform(-0.6, 0.6), random.uniform(0.5, 0.8) * reach
    place = distance * np.cos(angle), distance * np.sin(angle), 0.5
    shape = Box((0.1, 0.1, 1.0)) if random.random() < 0.5 else Cylinder(0.05, 1.0)
    return [Obstacle("post", shape, transform(None, place))]


def _shelf(random: np.random.Generator, reach: float) -> list[Obstacle]:
    x, width, depth = random.uniform(0.65, 0.8) * reach, 0.8 * reach, 0.3 * reach
    heights = random.uniform(0.25, 0.45) + np.array([0.0, random.uniform(0.3, 0.4)])
    boards = [
        Obstacle(f"board{k}", Box((depth, width, 0.02)), transform(None, (x, 0.0, z)))
        for k, z in enumerate(heights)
    ]
    sides = [
        Obstacle(f"side{k}", Box((depth, 0.02, 0.8)), transform(None, (x, y, 0.4)))
        for k, y in enumerate((-0.5 * width, 0.5 * width))
    ]
    return boards + sides


def _table(random: np.random.Generator, reach: float) -> list[Obstacle]:
    z = random.uniform(0.05, 0.25)
    top = Obstacle("table", Box((0.7 * reach, 1.4 * reach, 0.04)),
                   transform(None, (0.7 * reach, 0.0, z)))  # fmt: skip
    things = []
    for k in range(3):
        size = random.uniform(0.06, 0.18, 2)
        height = random.uniform(0.1, 0.3)
        place = random.uniform([0.45, -0.5], [0.85, 0.5]) * reach
        things.append(
            Obstacle(f"thing{k}", Box((*size, height)),
                     transform(None, (*place, z + 0.02 + 0.5 * height)))
        )  # fmt: skip
    return [top, *things]


def _clutter(random: np.random.Generator, reach: float) -> list[Obstacle]:
    things = []
    for k in range(8):
        place = random.uniform([-0.8, -0.8, 0.1], [0.8, 0.8, 1.0]) * reach
        if np.hypot(*place[:2]) < 0.3 * reach:
            continue
        shape = Sphere(random.uniform(0.04, 0.1)) if k % 2 else Box(random.uniform(0.06, 0.2, 3))
        things.append(Obstacle(f"thing{k}", shape, transform(None, place)))
    return things


KINDS: dict[str, Callable[[np.random.Generator, float], list[Obstacle]]] = {
    "post": _post, "shelf": _shelf, "table": _table, "clutter": _clutter,
}  # fmt: skip


def with_room(
    robot: RobotGeometry, kind: str, preferred: float, random: np.random.Generator
) -> Problem:
    """A problem whose ends keep the preferred clearance and whose straight line does not."""
    low, high = robot.chain.sampling_bounds()
    low, high = np.maximum(low, -2.6), np.minimum(high, 2.6)
    reach = 0.85
    while True:
        scene = Scene(tuple(KINDS[kind](random, reach)))
        model = Checker.of(robot, scene).model
        own = PreferredClearance(preferred).own_links
        spacious = Checker(model.with_margins(preferred + 5e-3, own + 5e-4))
        ends = [q for q in random.uniform(low, high, (60, robot.chain.n)) if spacious.valid(q)]
        for start, goal in zip(ends[::2], ends[1::2], strict=False):
            a, b = start, goal
            if kind == "post":
                # Past the post: the first joint turns from one side to the other.
                a, b = np.array(start), np.array(start)
                a[0], b[0] = random.uniform(0.7, 1.3), -random.uniform(0.7, 1.3)
            if spacious.valid(a) and spacious.valid(b) and not spacious.free(a, b):
                return Problem(robot, scene, a, (JointGoal(b),))


def cases(arms: list[str], count: int, seed: int) -> Iterator[Case]:
    """Cases of all kinds, arms and clearances."""
    for arm in arms:
        robot = load_robot(arm)
        for kind in KINDS:
            for preferred in PREFERRED:
                random = np.random.default_rng([seed, ord(kind[0]), int(1e3 * preferred)])
                for _ in range(count):
                    yield Case(kind, arm, preferred, with_room(robot, kind, preferred, random))


def lacking(problem: Problem, motion: Trajectory, preferred: float) -> tuple[float, float]:
    """What a motion lacks to the preferred clearance at most [m], and for how long [s]."""
    model = Checker.of(problem.robot, problem.scene).model
    spacious = Checker(model.with_margins(preferred - ROUNDING, 0.0))
    count = int(motion.duration / PERIOD) + 2
    states: Array = motion.sample(np.linspace(0.0, motion.duration, count))
    near = ~spacious.each_valid(states)
    if not near.any():
        return 0.0, 0.0
    worst, _, _ = spacious.closest(states[near], 0.0)
    return -worst, float(near.mean() * motion.duration)


def result(problem: Problem, preferred: float, looked: float, repeats: int = 1) -> Result | None:
    """The motion that a plan with a preferred clearance gives; None where there is none."""
    options, quickest = Options(clearance=PreferredClearance(preferred)), np.inf
    for _ in range(repeats):
        began = time.process_time()
        answer = plan(problem, options)
        quickest = min(quickest, 1e3 * (time.process_time() - began))
    if not isinstance(answer, Plan):
        return None
    return Result(
        quickest, answer.trajectory.duration, *lacking(problem, answer.trajectory, looked)
    )


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--arm", action="append")
    parser.add_argument("--count", type=int, default=6, help="problems of a kind, arm and distance")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--repeats", type=int, default=1, help="plans, the quickest of which counts"
    )
    parser.add_argument("--verbose", action="store_true")
    asked = parser.parse_args()
    rows: defaultdict[str, list[tuple[float, ...]]] = defaultdict(list)
    for number, case in enumerate(cases(asked.arm or list(ARMS), asked.count, asked.seed)):
        preferred = case.preferred
        proved = result(replace(case.problem, margin=preferred), 0.0, preferred)
        near = result(case.problem, 0.0, preferred, asked.repeats)
        kept = result(case.problem, preferred, preferred, asked.repeats)
        if proved is None or near is None or kept is None:
            continue
        row = (*kept, *near, *proved)
        if asked.verbose and kept.lacking:
            print(number, case.kind, case.arm, preferred, *np.round(row, 4), flush=True)
        for name in ("all", case.kind, case.arm, f"{1e3 * preferred:g} mm"):
            rows[name].append(row)
    print(
        "            cases nearer  worst  below [s]    time: near, kept, proved [s]  ms near, kept"
    )
    for name, found in rows.items():
        v = np.array(found)
        sums = v.sum(axis=0)
        lacking_at_all, much = (v[:, 2] > least for least in (0.0, 1e-3))
        times = [sums[k] / sums[5] - 1.0 for k in (1, 9)]
        print(
            f"{name:10} {len(v):6d} {lacking_at_all.mean():6.1%} (> 1 mm {much.mean():5.1%})"
            f" {1e3 * v[:, 2].max():6.1f} mm {sums[3]:6.2f} (without: {sums[7]:6.2f}) |"
            f" {sums[5]:7.2f} {times[0]:+6.1%} {times[1]:+6.1%} |"
            f" {sums[4]:7.0f} {sums[0] / sums[4] - 1:+5.0%}",
            flush=True,
        )


if __name__ == "__main__":
    main()
