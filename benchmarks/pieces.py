"""Pieces and bytes of planned motions: for each 1.6 s, of shorter ones as they are.

    python -m benchmarks.pieces ../data/mbm/panda [--every 5] [--kinds plain upright ...]
    python -m benchmarks.pieces ../data/mbm/panda --kinds --arms panda ur5e kr6_sixx ur5 --count 50

Kinds: "plain", MotionBenchMaker's problems; "upright", with a vertical axis of the flange within
10 degrees (`benchmarks.constrained_plan`); "torque", plain within the torque limits of a Panda that
carries 5 kg; "speed", plain with the tool no faster than 0.5 m/s; "line", the tool led 0.2 m
straight from the goals; "corner", along three lines with rounded corners at 0.1 m/s; "seam", those
of `benchmarks.seams`, at its speed. Bytes are those of the segments in the answer's JSON. Limits
are judged by numpy.

With ``--arms`` random motions among boxes with the tool no faster than 0.5 m/s, and within torque
limits with a load where ``--load`` says so. Speeds of the tool are judged by pinocchio at 500
instants of each motion, torques likewise.
"""

import argparse
import json
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pinocchio

from benchmarks.constrained_plan import constrained_problem
from benchmarks.example_arms import ARMS
from benchmarks.goal_choice import arm
from benchmarks.mbm_problems import ACCELERATION, cases, panda
from benchmarks.mesh_scenes import own_scenes
from benchmarks.ratios import worst_ratio
from benchmarks.seam_arms import SPEED, STARTS
from benchmarks.seams import SHAPES, seam
from benchmarks.timing_plans import JERK
from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.pose import transform
from kinematics.robots import builtin_names, builtin_urdf
from kinematics.trajectory import Trajectory
from obstacles.checker import Checker
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
#: Random motions: speed of the tool [m/s], largest angle of a joint, least clearance of ends [m],
#: instants that are judged, and by how much a limit may be exceeded where it is reached.
TOOL_SPEED, TURN, CLEAR, INSTANTS, ABOVE = 0.5, 2.6, 2e-3, 500, 1e-9


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


class Judge:
    """Speeds of a tool and torques by pinocchio.

    Args:
        urdf: The arm.
        robot: The same.
        load: Mass of a point at the tip [kg].
    """

    def __init__(self, urdf: str, robot: RobotGeometry, load: float) -> None:
        chain = robot.chain
        self._model = pinocchio.buildModelFromXML(urdf)
        self._tip = self._model.getFrameId(chain.tip_link, pinocchio.FrameType.BODY)
        if load:
            frame = self._model.frames[self._tip]
            inertia = pinocchio.Inertia(load, frame.placement.translation, np.zeros((3, 3)))
            self._model.appendBodyToJoint(frame.parentJoint, inertia, pinocchio.SE3.Identity())
        self._data = self._model.createData()
        joints = self._model.joints
        self._columns = [joints[self._model.getJointId(name)].idx_q for name in chain.joint_names]

    def uses(self, motion: Trajectory, effort: Array) -> tuple[float, float]:
        """Largest speed of the tool [m/s], and largest part of a torque limit that is used."""
        times = np.linspace(0.0, motion.duration, INSTANTS)
        q, v, a = (motion.sample(times, order) for order in range(3))
        fastest, strongest = 0.0, 0.0
        whole = np.zeros((3, self._model.nq))
        for k in range(INSTANTS):
            for row, values in enumerate((q[k], v[k], a[k])):
                whole[row, self._columns] = values
            pinocchio.forwardKinematics(self._model, self._data, whole[0], whole[1])
            twist = pinocchio.getFrameVelocity(
                self._model, self._data, self._tip, pinocchio.LOCAL_WORLD_ALIGNED
            )
            fastest = max(fastest, float(np.linalg.norm(twist.linear)))
            torque = pinocchio.rnea(self._model, self._data, *whole)[self._columns]
            strongest = max(strongest, float(np.abs(torque / effort).max()))
        return fastest, strongest


def random_problems(
    robot: RobotGeometry, count: int, load: float
) -> Iterator[tuple[Problem, Options]]:
    """Random motions among boxes, the tool no faster than ``TOOL_SPEED`` or with a load."""
    random, (low, high) = np.random.default_rng(0), robot.chain.sampling_bounds()
    timing = TimingOptions(tool_speed=TOOL_SPEED)
    if load:
        timing = TimingOptions(torque_limits=True, payload=Payload(load))
    scenes, made = list(own_scenes(30, 0.9, 0)), 0
    while made < count:
        scene = scenes[made % len(scenes)]
        start, end = np.clip(random.uniform(low, high, (2, robot.chain.n)), -TURN, TURN)
        if min(Checker.of(robot, scene).clearance(q)[0] for q in (start, end)) < CLEAR:
            continue
        made += 1
        options = Options(timing=timing, timeout=20.0)
        yield Problem(robot, scene, start, (JointGoal(end),)), options


def run_arm(name: str, count: int, load: float) -> None:
    """Plan an arm's random motions and tell their pieces, times and limits."""
    robot = arm(name)
    limits = robot.chain.limits
    judge = Judge(builtin_urdf(name) if name in builtin_names() else ARMS[name].text, robot, load)
    rates, sizes, durations, spent = [], [], [], []
    above, solvers, planned = 0, Counter[str](), 0
    for problem, options in random_problems(robot, count, load):
        if not planned:
            plan(problem, options)
        began = time.process_time()
        answer = plan(problem, options)
        planned += 1
        if not isinstance(answer, Plan):
            continue
        spent.append(time.process_time() - began)
        motion = answer.trajectory
        share = LENGTH / max(motion.duration, LENGTH)
        rates.append(motion.pieces * share)
        sizes.append(size(motion) * share)
        durations.append(motion.duration)
        solvers[str(answer.timing.solver if answer.timing else None)] += 1
        speed, torque = judge.uses(motion, limits.effort)
        jerk = 10.0 * limits.acceleration if limits.jerk is None else limits.jerk
        jerk = np.where(np.isfinite(jerk), jerk, 10.0 * limits.acceleration)
        bounds = (limits.velocity, limits.acceleration, jerk)
        ratios = [worst_ratio(motion, value, k) for k, value in enumerate(bounds, 1)]
        ratios.append(torque if load else speed / TOOL_SPEED)
        above += max(ratios) > 1.0 + ABOVE or not answer.certificate.verified
    print(
        f"| {name} | {len(rates)} | {np.median(rates):.1f} / {np.quantile(rates, 0.95):.1f} "
        f"| {np.median(sizes) / 1e3:.1f} / {np.quantile(sizes, 0.95) / 1e3:.1f} "
        f"| {sum(durations):.3f} s | {1e3 * np.median(spent):.1f} ms | {above} above a limit "
        f"| {dict(solvers)} |",
        flush=True,
    )


def main() -> None:
    """Print a row a kind."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("--every", type=int, default=5, help="take every n-th problem of a kind")
    parser.add_argument("--kinds", nargs="*", default=KINDS)
    parser.add_argument("--arms", nargs="*", default=[], help="of random motions")
    parser.add_argument("--count", type=int, default=50, help="random motions of each arm")
    parser.add_argument("--load", type=float, default=0.0, help="at the tip, for torques [kg]")
    asked = parser.parse_args()
    for name in asked.arms:
        run_arm(name, asked.count, asked.load)
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
