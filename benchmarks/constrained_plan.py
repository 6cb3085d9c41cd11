"""Carrying a glass through MotionBenchMaker scenes: how many are solved, how fast, is it upright?

    python -m benchmarks.constrained_plan ../data/mbm/panda [--kind upright] [--every 1]

For each problem the axis of the flange that is vertical in the given goal has to stay within 10
degrees of the vertical. Start and goal are made near those given by constrained inverse kinematics;
a problem for which it finds none of either is left out. Kinds: "upright"; "plane", the tip in a
slab of a centimetre through start and goal; "fixed", the orientation within 0.05 rad. Every motion
is looked at by ``benchmarks.recheck`` every milliradian, and its constraint by pinocchio's frames
every half milliradian.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio

from benchmarks.mbm_problems import ACCELERATION, cases, panda
from benchmarks.recheck import Recheck
from kinematics.chain import Array
from kinematics.forward import forward
from kinematics.trajectory import Trajectory
from obstacles.moveit import scene_from_moveit
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene
from planning.constrained_ik import IkOptions, constrained_ik
from planning.constraints.constraint import Geometric
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.limit import ClearanceConstraint
from planning.constraints.orientation import ConeConstraint, OrientationConstraint
from planning.constraints.position import PositionConstraint
from planning.constraints.region import PlaneRegion, SphereRegion
from planning.options import Options
from planning.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Failure

#: The cone, and what start and goal keep of it [rad].
CONE, ENDS = np.radians(10.0), np.radians(9.0)
SLAB, TURN = 0.005, 0.05
#: How far from the given ones start and goal may be [m], and what they keep from obstacles [m].
_NEAR, _CLEAR = (0.01, 0.1, 0.2, 0.4), 0.003
_STEP = 5e-4


@dataclass
class Tally:
    """What came of the problems of one kind of scene."""

    made: int = 0
    solved: int = 0
    violating: int = 0
    unclean: int = 0
    seconds: list[float] = field(default_factory=list)
    bounds: list[float] = field(default_factory=list)
    dense: list[float] = field(default_factory=list)
    durations: list[float] = field(default_factory=list)


def ends(robot: RobotGeometry, scene: Scene, near: Array, constraint: Geometric) -> Array | None:
    """A configuration near a given one that holds a constraint with something to spare."""
    tip = forward(robot.chain, near)[:3, 3]
    for radius in _NEAR:
        region = PositionConstraint(SphereRegion(tip, radius))
        wanted = ConstraintSet(robot.chain, (constraint, region, ClearanceConstraint(_CLEAR)))
        found = constrained_ik(robot, wanted, scene, IkOptions(posture=near, starts=40))
        if found.solutions:
            return np.array(found.solutions[0].joints)
    return None


def made(
    kind: str, robot: RobotGeometry, scene: Scene, start: Array, goal: Array
) -> tuple[Array, Array, Geometric] | None:
    """A constrained problem made of an unconstrained one."""
    R = forward(robot.chain, goal)[:3, :3]
    up = R.T @ [0.0, 0.0, 1.0]
    narrow: Geometric = ConeConstraint(up, [0.0, 0.0, 1.0], ENDS)
    wide: Geometric = ConeConstraint(up, [0.0, 0.0, 1.0], CONE)
    if kind == "fixed":
        narrow, wide = OrientationConstraint(R, 0.9 * TURN), OrientationConstraint(R, TURN)
    first, last = ends(robot, scene, start, narrow), ends(robot, scene, goal, narrow)
    if first is None or last is None:
        return None
    if kind == "plane":
        a, b = (forward(robot.chain, q)[:3, 3] for q in (first, last))
        normal = np.cross(b - a, np.cross([0.0, 0.0, 1.0], b - a))
        wide = PositionConstraint(PlaneRegion(0.5 * (a + b), np.cross(b - a, normal), SLAB))
    return first, last, wide


class Dense:
    """The constraint by pinocchio's frames, sampled."""

    def __init__(self, recheck: Recheck, tip: str) -> None:
        self._model, self._data = recheck.model, recheck.data
        self._tip = self._model.getFrameId(tip)

    def worst(self, trajectory: Trajectory, constraint: Geometric) -> float:
        """The largest residual that samples find."""
        return max(self._residual(q, constraint) for q in _samples(trajectory))

    def _residual(self, q: Array, constraint: Geometric) -> float:
        pinocchio.framesForwardKinematics(self._model, self._data, q)
        T = self._data.oMf[self._tip].homogeneous
        if isinstance(constraint, ConeConstraint):
            cosine = T[:3, :3] @ np.asarray(constraint.axis) @ np.asarray(constraint.direction)
            return float(np.arccos(np.clip(cosine, -1.0, 1.0))) - constraint.cone_angle
        if isinstance(constraint, OrientationConstraint):
            left = pinocchio.log3(constraint.rotation.T @ T[:3, :3])
            return float(np.abs(left).max() - np.asarray(constraint.axis_tolerances).max())
        assert isinstance(constraint, PositionConstraint)
        assert isinstance(constraint.region, PlaneRegion)
        offset = T[:3, 3] - np.asarray(constraint.region.point)
        return float(abs(np.asarray(constraint.region.normal) @ offset)) - SLAB


def _samples(trajectory: Trajectory) -> Iterator[Array]:
    for k in range(trajectory.pieces):
        h = trajectory.breaks[k + 1] - trajectory.breaks[k]
        c = trajectory.coefficients[k].T
        reach = float((np.abs(c[1:]) * (h ** np.arange(1, len(c)))[:, None]).sum(0).max())
        times = np.linspace(0.0, h, max(2, int(np.ceil(reach / _STEP)) + 1))
        yield from times[:, None] ** np.arange(len(c)) @ c


def run(folder: Path, kind: str, every: int, timeout: float, seed: int) -> dict[str, Tally]:
    """Make, plan and re-check every problem; one tally a kind of scene."""
    robot_folder = folder.parent.parent / "panda"
    robot, recheck = panda(robot_folder), Recheck(robot_folder)
    dense = Dense(recheck, robot.chain.tip_link)
    tallies: dict[str, Tally] = {}
    warm = True
    for case in cases(folder, robot.chain.joint_names, every):
        name, text = case.name, case.text
        tally = tallies.setdefault(case.kind, Tally())
        scene = scene_from_moveit(text)
        found = made(kind, robot, scene, case.start, case.goal)
        if found is None:
            print(f"  {name}: no start or goal", flush=True)
            continue
        first, last, constraint = found
        tally.made += 1
        wanted = ConstraintSet(robot.chain, (constraint,))
        problem = Problem(robot, scene, first, (JointGoal(last),), constraints=wanted)
        options = Options(timeout=timeout, seed=seed)
        if warm:
            plan(problem, options)
            warm = False
        began = time.process_time()
        answer = plan(problem, options)
        spent = time.process_time() - began
        if isinstance(answer, Failure):
            print(f"  {name}: {answer.code} {answer.message}", flush=True)
            continue
        tally.solved += 1
        tally.seconds.append(spent)
        tally.durations.append(answer.trajectory.duration)
        tally.bounds.append(answer.certificate.path_constraints[0].residual)
        tally.dense.append(dense.worst(answer.trajectory, constraint))
        tally.violating += tally.dense[-1] > max(1e-6, tally.bounds[-1])
        motion = answer.trajectory
        seen = recheck.motion(
            motion.breaks, motion.coefficients, np.array(ACCELERATION), recheck.scene(text)
        )
        tally.unclean += seen.colliding is not None or seen.limit_ratio > 1.0 + 1e-9
    return tallies


def report(tallies: dict[str, Tally]) -> None:
    """Print one row a kind of scene."""
    head = "kind                     made solved | cpu ms med    p95    max | worst bound"
    print(head + "      dense | violating unclean | motion s")
    for kind, tally in tallies.items():
        ms = 1e3 * np.array(tally.seconds or [np.nan])
        print(
            f"{kind:24} {tally.made:4d} {tally.solved:6d} | {np.median(ms):10.0f} "
            f"{np.percentile(ms, 95):6.0f} {ms.max():6.0f} "
            f"| {max(tally.bounds, default=np.nan):11.2e} {max(tally.dense, default=np.nan):10.2e} "
            f"| {tally.violating:9d} {tally.unclean:7d} "
            f"| {np.median(tally.durations or [np.nan]):8.2f}"
        )
    total, solved = (sum(getattr(t, name) for t in tallies.values()) for name in ("made", "solved"))
    print(f"solved {solved} of {total}")


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("--kind", choices=("upright", "plane", "fixed"), default="upright")
    parser.add_argument("--every", type=int, default=1, help="take every n-th problem of a kind")
    parser.add_argument("--timeout", type=float, default=5.0)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    report(run(asked.problems, asked.kind, asked.every, asked.timeout, asked.seed))


if __name__ == "__main__":
    main()
