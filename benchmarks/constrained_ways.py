"""Plans under constraints beside ways that are known: ``python -m benchmarks.constrained_ways``.

    python -m benchmarks.constrained_ways [--robots panda ur5] [--kinds fixed mixed] [--count 20]

Every problem is feasible by construction. From a random configuration that is free, an arm wanders
along the set that a constraint allows; then boxes are put around the way, each nearer than ``NEAR``
to it and none nearer than ``CLEAR``, and the ends of the way are asked for, as joints or as a pose.
Problems that a straight joint motion solves are left out. Kinds: "upright" (a cone of 0.1 rad),
"fixed" (the orientation within 0.05 rad), "plane" (within 5 mm of one), "mixed" (a cone, a box and
bands of three joints about the way, with ``SPARE`` to spare). With ``--tight`` there are more
boxes, nearer to the way, and less is to spare.

Told are processor times, one thread. Every motion is judged by pinocchio's frames every half
milliradian, and by FCL every five.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
import pinocchio

from benchmarks.example_arms import ARMS
from benchmarks.fcl_judge import FclJudge
from benchmarks.verdict import builtin
from kinematics.arrays import Array
from kinematics.forward import forward, link_poses
from kinematics.pose import from_rpy, transform
from kinematics.trajectory import Trajectory
from obstacles.checker import Checker
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Obstacle, Scene
from obstacles.shapes import Box
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.projected_rrt import Manifold
from planning.constraints.constraint import Constraint
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.joint import JointConstraint
from planning.constraints.orientation import ConeConstraint, OrientationConstraint
from planning.constraints.position import PositionConstraint
from planning.constraints.region import BoxRegion, PlaneRegion
from planning.options import Options
from planning.pipeline import plan
from planning.problem import Goal, JointGoal, PoseGoal, Problem
from planning.result import Failure

KINDS = ("upright", "fixed", "plane", "mixed")
LIMITS = {"velocity": 2.0, "acceleration": 8.0, "jerk": 80.0}
CONE, TURN, SLAB, SPARE = 0.1, 0.05, 5e-3, 5e-3
#: How near the boxes are to the way [m].
CLEAR, NEAR = 0.01, 0.12
_BOXES = 8
#: What these are with --tight.
TIGHT = {"CLEAR": 5e-3, "NEAR": 0.05, "SPARE": 3e-3, "_BOXES": 14}
#: A step of the way [rad or m], how many it has, and the least share of them that makes one.
_STEP, _STEPS, _LEAST = 0.05, 100, 0.6
#: Ways that are begun for each one that is wanted.
_TRIES = 100


def arm(name: str) -> RobotGeometry:
    """An arm of example-robot-data by its name there, or a built-in one as "built-in:name"."""
    if name.startswith("built-in:"):
        return builtin(name.removeprefix("built-in:"))
    return ARMS[name].geometry(LIMITS)


@dataclass(frozen=True)
class Way:
    """A problem and the way that solves it."""

    problem: Problem
    way: Array


def _constraints(kind: str, robot: RobotGeometry, q: Array, share: float = 1.0) -> list[Constraint]:
    """What holds along the way but for bands and boxes, with a share of its tolerance."""
    T = forward(robot.chain, q)
    if kind == "fixed":
        return [OrientationConstraint(T[:3, :3], share * TURN)]
    if kind == "plane":
        return [PositionConstraint(PlaneRegion(T[:3, 3], [0.0, 0.0, 1.0], share * SLAB))]
    up = T[:3, :3].T @ [0.0, 0.0, 1.0]
    return [ConeConstraint(up, [0.0, 0.0, 1.0], share * CONE)]


def _wander(robot: RobotGeometry, kind: str, random: np.random.Generator) -> Array | None:
    """A way along the allowed set, (k, n); None where it ends too early."""
    chain = robot.chain
    low, high = chain.sampling_bounds()
    plain = Checker.of(robot, Scene(()), 0.0)
    q = random.uniform(np.maximum(low, -np.pi), np.minimum(high, np.pi))
    if plain.clearance(q)[0] <= 0.0:
        return None
    narrow = ConstraintSet(chain, tuple(_constraints(kind, robot, q, 0.8)))
    spare = np.zeros(len(narrow.rows))
    held = ConstrainedChecker(plain.model, plain.slack, constraints=narrow, spare=spare)
    way, heading = [q], random.normal(size=chain.n)
    while len(way) <= _STEPS:
        step = None
        for _ in range(4):
            step = _step(Manifold(held), way[-1], heading)
            if step is not None:
                break
            heading = random.normal(size=chain.n)
        if step is None:
            break
        along = (step - way[-1]) / np.linalg.norm(step - way[-1])
        heading = 0.8 * np.sqrt(chain.n) * along + 0.25 * random.normal(size=chain.n)
        way.append(step)
    return np.array(way) if len(way) > _LEAST * _STEPS else None


def _step(manifold: Manifold, q: Array, heading: Array) -> Array | None:
    """A free step along the allowed set in about that direction, if there is one."""
    low, high = manifold.checker.model.chain.sampling_bounds()
    ahead = np.clip(q + _STEP * heading / np.linalg.norm(heading), low, high)
    step = manifold.project(ahead)
    if step is None or not 0.3 * _STEP < np.linalg.norm(step - q) < 2.0 * _STEP:
        return None
    return step if manifold.checker.free(q, step) else None


def _boxes(robot: RobotGeometry, way: Array, random: np.random.Generator) -> Scene:
    """Boxes about the way, where the straight motion leads if there is room."""
    boxes: list[Obstacle] = []
    chain = robot.chain
    links = [link.name for link in chain.links]
    for k in range(60):
        if len(boxes) == _BOXES:
            break
        share = random.uniform()
        q = way[0] + share * (way[-1] - way[0]) if k % 2 else way[random.integers(len(way))]
        poses = link_poses(chain, q, links[len(links) // 2 :])
        place = poses[random.integers(len(poses)), :3, 3] + random.normal(size=3) * 0.12
        T = transform(from_rpy(random.uniform(-np.pi, np.pi, 3)), place)
        box = Obstacle(f"box{len(boxes)}", Box(random.uniform(0.04, 0.3, 3)), T)
        checker = Checker.of(robot, Scene((box,)), 0.0)
        least = min(_obstacle_clearance(checker, box.id, point) for point in way)
        if CLEAR < least < NEAR:
            boxes.append(box)
    return Scene(tuple(boxes))


def _obstacle_clearance(checker: Checker, name: str, q: Array) -> float:
    """Clearance, where the least is of a pair with the obstacle; that of others is enough."""
    clearance, pair = checker.clearance(q)
    return clearance if name in (pair or ()) or clearance <= 0.0 else max(clearance, 2.0 * CLEAR)


def _about_the_way(
    robot: RobotGeometry, way: Array, random: np.random.Generator
) -> Iterator[Constraint]:
    chain = robot.chain
    places = np.array([forward(chain, q)[:3, 3] for q in way])
    low, high = places.min(axis=0) - SPARE, places.max(axis=0) + SPARE
    yield PositionConstraint(BoxRegion(transform(None, 0.5 * (low + high)), high - low))
    for j in random.choice(chain.n, 3, replace=False):
        first, last = way[:, j].min() - SPARE, way[:, j].max() + SPARE
        half = 0.5 * (last - first)
        yield JointConstraint(chain.joint_names[j], 0.5 * (first + last), half, half)


def ways(robot: RobotGeometry, kind: str, goal: str, count: int, seed: int) -> Iterator[Way]:
    """Feasible problems of one kind, each with its way."""
    made = tried = 0
    while made < count and tried < _TRIES * count:
        random = np.random.default_rng((seed, KINDS.index(kind), tried))
        tried += 1
        way = _wander(robot, "upright" if kind == "mixed" else kind, random)
        if way is None:
            continue
        asked = _constraints(kind, robot, way[0])
        if kind == "mixed":
            asked += list(_about_the_way(robot, way, random))
        constraints = ConstraintSet(robot.chain, tuple(asked))
        scene = _boxes(robot, way, random)
        plain = Checker.of(robot, scene, 0.0)
        spare = np.zeros(len(constraints.rows))
        held = ConstrainedChecker(plain.model, plain.slack, constraints=constraints, spare=spare)
        if held.free(way[0], way[-1]) or not all(held.free(a, b) for a, b in pairwise(way)):
            continue
        aim: Goal = JointGoal(way[-1])
        if goal == "pose":
            aim = PoseGoal(forward(robot.chain, way[-1]))
        made += 1
        yield Way(Problem(robot, scene, way[0], (aim,), constraints=constraints), way)


class Frames:
    """Constraints by pinocchio's frames."""

    def __init__(self, robot: RobotGeometry, urdf: str) -> None:
        self._model = pinocchio.buildModelFromXML(urdf)
        self._data = self._model.createData()
        self._tip = self._model.getFrameId(robot.chain.tip_link, pinocchio.FrameType.BODY)
        self._names = list(robot.chain.joint_names)
        self._rest = pinocchio.neutral(self._model)
        self._places = [
            self._model.joints[self._model.getJointId(name)].idx_q for name in self._names
        ]

    def worst(self, motion: Array, constraints: ConstraintSet) -> float:
        """The largest residual at configurations (k, n)."""
        return max(self._residual(q, c) for q in motion for c in constraints.constraints)

    def _residual(self, q: Array, constraint: Constraint) -> float:
        if isinstance(constraint, JointConstraint):
            off = q[self._names.index(constraint.joint)] - constraint.position
            return float(max(off - constraint.tolerance_above, -off - constraint.tolerance_below))
        whole = self._rest.copy()
        whole[self._places] = q
        pinocchio.framesForwardKinematics(self._model, self._data, whole)
        T = self._data.oMf[self._tip].homogeneous
        if isinstance(constraint, ConeConstraint):
            cosine = np.asarray(constraint.direction) @ T[:3, :3] @ np.asarray(constraint.axis)
            return float(np.arccos(np.clip(cosine, -1.0, 1.0))) - constraint.cone_angle
        if isinstance(constraint, OrientationConstraint):
            turn = pinocchio.log3(np.asarray(constraint.rotation).T @ T[:3, :3])
            return float(np.abs(turn).max() - np.asarray(constraint.axis_tolerances).max())
        assert isinstance(constraint, PositionConstraint)
        region = constraint.region
        if isinstance(region, PlaneRegion):
            off = np.asarray(region.normal) @ (T[:3, 3] - np.asarray(region.point))
            return float(abs(off)) - region.tolerance
        assert isinstance(region, BoxRegion)
        inside = region.T
        place = inside[:3, :3].T @ (T[:3, 3] - inside[:3, 3])
        return float(np.max(np.abs(place) - 0.5 * np.asarray(region.size)))


def samples(trajectory: Trajectory, step: float) -> Array:
    """Configurations of a motion, no joint moving by more than ``step`` between two of them."""
    count = int(np.ceil(200 * trajectory.duration)) + 2
    q = trajectory.sample(np.linspace(0.0, trajectory.duration, count))
    finer = max(1.0, float(np.abs(np.diff(q, axis=0)).max()) / step)
    return trajectory.sample(np.linspace(0.0, trajectory.duration, int(finer * count) + 1))


@cache
def _frames(name: str) -> Frames | None:
    return None if name.startswith("built-in:") else Frames(arm(name), ARMS[name].text)


def run(name: str, kind: str, goal: str, count: int, timeout: float, seed: int) -> None:
    """Plan the problems of one arm and kind and tell what came of them."""
    robot, spent, failed, unclean, violating = arm(name), [], [], 0, 0
    for k, known in enumerate(ways(robot, kind, goal, count, seed)):
        if not k:
            plan(known.problem, Options(timeout=timeout))
        began = time.process_time()
        answer = plan(known.problem, Options(timeout=timeout))
        taken = time.process_time() - began
        if isinstance(answer, Failure):
            failed.append(k)
            print(f"  {name} {kind} {k}: {answer.code} {taken:.2f} s, {answer.details}", flush=True)
            continue
        spent.append(taken)
        assert known.problem.constraints is not None
        frames = _frames(name)
        if frames is not None:
            off = frames.worst(samples(answer.trajectory, 5e-4), known.problem.constraints)
            violating += off > 1e-6
        judge = FclJudge(robot, known.problem.scene)
        unclean += any(judge.collides(q) for q in samples(answer.trajectory, 5e-3))
    times = 1e3 * np.array(spent or [np.nan])
    print(
        f"{name:16} {kind:8} {goal:6} solved {len(spent)}/{len(spent) + len(failed)}, "
        f"violating {violating}, unclean {unclean}, ms {np.median(times):.0f} median "
        f"{np.quantile(times, 0.95):.0f} p95 {times.max():.0f} max, failed {failed}",
        flush=True,
    )


def main() -> None:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", nargs="+", default=["panda", "ur5", "z1"])
    parser.add_argument("--kinds", nargs="+", default=KINDS)
    parser.add_argument("--goal", choices=("joints", "pose"), default="joints")
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--timeout", type=float, default=5.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tight", action="store_true")
    asked = parser.parse_args()
    globals().update(TIGHT if asked.tight else {})
    for name in asked.robots:
        for kind in asked.kinds:
            run(name, kind, asked.goal, asked.count, asked.timeout, asked.seed)


if __name__ == "__main__":
    main()
