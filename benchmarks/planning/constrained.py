"""Carrying a glass through MotionBenchMaker scenes: how many are solved, how fast, is it upright?

    python -m benchmarks.planning.constrained ../data/mbm/panda [--kind upright] [--every 1]

For each problem the axis of the flange that is vertical in the given goal has to stay within 10
degrees of the vertical. Start and goal are made near those given by constrained inverse kinematics;
a problem for which it finds none of either is left out. Kinds: "upright"; "plane", the tip in a
slab of a centimetre through start and goal; "fixed", the orientation within 0.05 rad. With
``--goal pose`` the goal is the pose of the tip there, in any configuration. A problem that is not
solved is tried again without obstacles for ten times as long: where even that finds no way, start
and goal lie in parts of the allowed set that nothing was found to join ("apart").

Solved is what took at most five seconds of processor time. Every motion is looked at by
``benchmarks.judges.recheck`` every milliradian, and its constraint by pinocchio's frames every half
milliradian.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pinocchio

from benchmarks.judges.recheck import Recheck
from benchmarks.mbm_problems import ACCELERATION, Case, cases, panda, scene_at_root
from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.constrained.ik import IkOptions, constrained_ik
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import (
    ClearanceConstraint,
    ConeConstraint,
    Geometric,
    OrientationConstraint,
    PlaneRegion,
    PositionConstraint,
    SphereRegion,
)
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import Goal, JointGoal, PoseGoal, Problem
from planning.result import Failure

#: The cone, and what start and goal keep of it [rad].
CONE, ENDS = np.radians(10.0), np.radians(9.0)
SLAB, TURN = 0.005, 0.05
#: How far from the given ones start and goal may be [m], and what they keep from obstacles [m].
_NEAR, _CLEAR = (0.01, 0.1, 0.2, 0.4), 0.003
_STEP = 5e-4
#: Time that a plan may take by the clock, and of a processor to count as solved [s].
TIMEOUT, WITHIN = 15.0, 5.0


@dataclass
class Tally:
    """What came of the problems of one kind of scene."""

    made: int = 0
    left_out: int = 0
    apart: int = 0
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


def constrained_problem(
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


class Bench:
    """Makes, plans and re-checks every problem."""

    def __init__(self, asked: argparse.Namespace) -> None:
        robot_folder = asked.problems.parent.parent / "panda"
        self._asked = asked
        self._robot, self._recheck = panda(robot_folder), Recheck(robot_folder, ACCELERATION)
        self._dense = Dense(self._recheck, self._robot.chain.tip_link)
        self._warm = False

    def run(self) -> dict[str, Tally]:
        """One tally a kind of scene."""
        tallies: dict[str, Tally] = {}
        for case in cases(self._asked.problems, self._robot.chain.joint_names, self._asked.every):
            tally = tallies.setdefault(case.kind, Tally())
            scene = scene_at_root(case.text)
            found = constrained_problem(self._asked.kind, self._robot, scene, case.start, case.goal)
            if found is None:
                print(f"  {case.name}: no start or goal", flush=True)
                tally.left_out += 1
            else:
                tally.made += 1
                self._solve(case, scene, *found, tally)
        return tallies

    def _solve(
        self, case: Case, scene: Scene, first: Array, last: Array, constraint: Geometric,
        tally: Tally,
    ) -> None:  # fmt: skip
        wanted = ConstraintSet(self._robot.chain, (constraint,))
        goal: Goal = JointGoal(last)
        if self._asked.goal == "pose":
            goal = PoseGoal(forward(self._robot.chain, last))
        problem = Problem(self._robot, scene, first, (goal,), constraints=wanted)
        options = Options(timeout=TIMEOUT)
        if not self._warm:
            plan(problem, options)
            self._warm = True
        began = time.process_time()
        answer = plan(problem, options)
        spent = time.process_time() - began
        if isinstance(answer, Failure) or spent > WITHIN:
            empty = replace(problem, scene=Scene(()))
            alone = plan(empty, replace(options, timeout=10.0 * WITHIN))
            apart = isinstance(alone, Failure)
            tally.apart += apart
            why = answer.code if isinstance(answer, Failure) else "took"
            print(f"  {case.name}: {why} {spent:.1f} s{', apart' if apart else ''}", flush=True)
            return
        tally.solved += 1
        tally.seconds.append(spent)
        tally.durations.append(answer.trajectory.duration)
        tally.bounds.append(answer.certificate.path_constraints[0].residual)
        tally.dense.append(self._dense.worst(answer.trajectory, constraint))
        tally.violating += tally.dense[-1] > max(1e-6, tally.bounds[-1])
        motion, truth = answer.trajectory, self._recheck.scene(case.text)
        seen = self._recheck.motion(motion.breaks, motion.coefficients, truth)
        tally.unclean += not seen.clean


def report(tallies: dict[str, Tally]) -> None:
    """Print one row a kind of scene."""
    head = "kind                     none made apart solved | cpu ms med    p95    max | worst"
    print(head + " bound      dense | violating unclean | motion s")
    for kind, tally in tallies.items():
        ms = 1e3 * np.array(tally.seconds or [np.nan])
        print(
            f"{kind:24} {tally.left_out:4d} {tally.made:4d} {tally.apart:5d} {tally.solved:6d} "
            f"| {np.median(ms):10.0f} {np.percentile(ms, 95):6.0f} {ms.max():6.0f} "
            f"| {max(tally.bounds, default=np.nan):11.2e} {max(tally.dense, default=np.nan):10.2e} "
            f"| {tally.violating:9d} {tally.unclean:7d} "
            f"| {np.median(tally.durations or [np.nan]):8.2f}"
        )
    total = [sum(getattr(t, n) for t in tallies.values()) for n in ("made", "apart", "solved")]
    print(f"solved {total[2]} of {total[0]}, of which {total[1]} are apart without obstacles too")


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("--kind", choices=("upright", "plane", "fixed"), default="upright")
    parser.add_argument("--every", type=int, default=1, help="take every n-th problem of a kind")
    parser.add_argument("--goal", choices=("joints", "pose"), default="joints")
    report(Bench(parser.parse_args()).run())


if __name__ == "__main__":
    main()
