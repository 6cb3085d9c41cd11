"""Pieces and bytes of planned motions: for each 1.6 s, of shorter ones as they are.

    python -m benchmarks.pieces ../data/mbm/panda [--every 5] [--kinds plain upright ...]

Kinds: "plain", MotionBenchMaker's problems; "upright", with a vertical axis of the flange within
10 degrees (`benchmarks.constrained_plan`); "torque", plain within the torque limits of a Panda that
carries 5 kg; "speed", plain with the tool no faster than 0.5 m/s; "line", the tool led 0.2 m
straight from the goals; "corner", along three lines with rounded corners at 0.1 m/s; "seam", those
of `benchmarks.seams`, at its speed. Bytes are those of the segments in the answer's JSON. Limits
are judged by numpy.
"""

import argparse
import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.constrained_plan import constrained_problem
from benchmarks.mbm_problems import ACCELERATION, cases, panda
from benchmarks.ratios import worst_ratio
from benchmarks.seam_arms import SPEED, STARTS
from benchmarks.seams import SHAPES, seam
from benchmarks.timing_plans import JERK
from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.pose import transform
from kinematics.trajectory import Trajectory
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Obstacle, Scene
from obstacles.shapes import Cylinder
from planning.constraints.constraint_set import ConstraintSet
from planning.options import CartesianOptions, Options, ToolMotionOptions
from planning.pipeline import plan
from planning.problem import JointGoal, PoseGoal, Problem
from planning.result import Plan
from planning.seam_options import SeamOptions
from planning.timing.options import Payload, TimingOptions
from planning.tool_tolerance import ToolTolerance

KINDS = ("plain", "upright", "torque", "speed", "line", "corner", "seam")
#: Seams, each shape as often as the others.
SEAMS = 25
#: Length of a motion that pieces and bytes are told for, unless it is shorter [s].
LENGTH = 1.6
#: Pieces of such a motion at most; a span more where its length is rounded up [-].
MOST = 20.5
#: Bytes of such a motion at most [-].
BYTES = 8000.0


def size(motion: Trajectory) -> int:
    """Bytes of a motion's segments in an answer."""
    segments = [
        {"t0": a, "t1": b, "coefficients": c.tolist()}
        for a, b, c in zip(motion.breaks, motion.breaks[1:], motion.coefficients, strict=False)
    ]
    return len(json.dumps(segments, separators=(",", ":")))


def problems(kind: str, folder: Path, every: int) -> Iterator[tuple[Problem, Options]]:
    """Problems of a kind with their options."""
    robot = panda(folder.parent.parent / "panda")
    limits = {"acceleration": np.array(ACCELERATION), "jerk": np.array(JERK)}
    if kind == "seam":
        yield from seam_problems(robot, limits, max(SEAMS // every, 1))
        return
    for case in cases(folder, robot.chain.joint_names, every):
        problem = case.problem(robot, 0.0)
        options = Options(limits=limits, timeout=10.0)
        if kind == "upright":
            scene = problem.scene
            found = constrained_problem("upright", robot, scene, case.start, case.goal)
            if found is None:
                continue
            first, last, constraint = found
            wanted = ConstraintSet(robot.chain, (constraint,))
            problem = Problem(robot, scene, first, (JointGoal(last),), constraints=wanted)
        elif kind == "torque":
            load = Payload(5.0)
            timing = TimingOptions(torque_limits=True, payload=load)
            options = Options(limits=limits, timeout=10.0, timing=timing)
        elif kind == "speed":
            options = Options(limits=limits, timeout=10.0, timing=TimingOptions(tool_speed=0.5))
        elif kind in ("line", "corner"):
            problem, options = tool_problem(kind, robot, case.goal, limits)
        yield problem, options


def tool_problem(
    kind: str, robot: RobotGeometry, q: Array, limits: dict[str, Array]
) -> tuple[Problem, Options]:
    """A line away from a configuration, or three with rounded corners, without obstacles."""
    T = forward(robot.chain, q)
    inward = -T[:3, 3] * np.array([1.0, 1.0, 0.0])
    inward /= np.linalg.norm(inward)
    ends = [T[:3, 3] + 0.2 * inward]
    if kind == "corner":
        side = np.cross([0.0, 0.0, 1.0], inward)
        ends = [T[:3, 3] + 0.1 * inward]
        ends += [ends[0] + 0.1 * side, ends[0] + 0.1 * side + [0.0, 0.0, 0.1]]
    ways = tuple(ToolMotionOptions("lin", transform(T[:3, :3], end)) for end in ends)
    corner = kind == "corner"
    return (
        Problem(robot, Scene(), q, (PoseGoal(ways[-1].T_base_tip),)),
        Options(
            planner="cartesian",
            cartesian=CartesianOptions(motions=ways, blend=0.03 if corner else 0.0),
            timing=TimingOptions(tool_speed=0.1) if corner else TimingOptions(),
            limits=limits,
            timeout=10.0,
        ),
    )


def seam_problems(
    robot: RobotGeometry, limits: dict[str, Array], count: int
) -> Iterator[tuple[Problem, Options]]:
    """So many of the seams that ``benchmarks.seams`` asks of a Panda, past its post."""
    post = Obstacle("post", Cylinder(0.03, 0.8), transform(None, [0.45, 0.45, 0.4]))
    random, start = np.random.default_rng(7), np.array(STARTS["panda"])
    for k in range(count):
        tolerance = ToolTolerance.of({}, ("rz",), np.radians(5.0 if k % 2 else 15.0))
        asked = SeamOptions(seam(SHAPES[k % len(SHAPES)], random), tolerance, tool_speed=SPEED)
        yield (
            Problem(robot, Scene((post,)), start, (PoseGoal(asked.waypoints[-1].T_base_tip),)),
            Options(
                planner="cartesian",
                cartesian=CartesianOptions(seam=asked),
                limits=limits,
                timeout=20.0,
            ),
        )


def main() -> None:
    """Print a row a kind."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("--every", type=int, default=5, help="take every n-th problem of a kind")
    parser.add_argument("--kinds", nargs="*", default=KINDS)
    asked = parser.parse_args()
    print("| kind | motions | pieces, median / 95 % | kB, median / 95 % | above both | duration "
          "| worst limit | solvers |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|")
    for kind in asked.kinds:
        rates, sizes, durations, worst, solvers = [], [], [], 0.0, Counter[str]()
        for problem, options in problems(kind, asked.problems, asked.every):
            answer = plan(problem, options)
            if not isinstance(answer, Plan):
                continue
            motion = answer.trajectory
            share = LENGTH / max(motion.duration, LENGTH)
            rates.append(motion.pieces * share)
            sizes.append(size(motion) * share)
            durations.append(motion.duration)
            solvers[str(answer.timing.solver if answer.timing else None)] += 1
            assert options.limits is not None
            judged = {2: options.limits["acceleration"], 3: options.limits["jerk"]}
            ratios = [worst_ratio(motion, v, k) for k, v in judged.items()]
            worst = max(worst, *ratios)
        both = np.mean((np.array(rates) > MOST) & (np.array(sizes) > BYTES))
        low, high = np.quantile(rates, [0.5, 0.95])
        light, heavy = np.quantile(sizes, [0.5, 0.95]) / 1e3
        print(
            f"| {kind} | {len(rates)} | {low:.1f} / {high:.1f} | {light:.1f} / {heavy:.1f} "
            f"| {100.0 * both:.0f} % | {np.median(durations):.3f} s | {worst:.9f} "
            f"| {dict(solvers)} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
