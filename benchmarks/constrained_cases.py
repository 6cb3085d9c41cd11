"""Constrained problems that once failed: ``python -m benchmarks.constrained_cases PROBLEMS``.

    python -m benchmarks.constrained_cases ../data/mbm/panda [--count 91]

"tip box": MotionBenchMaker's problems in which the tip has to stay in a box around a way that is
known, the certified plan without it, with ``SPARE`` to spare. "own links": constrained inverse
kinematics without a scene, whose answers FCL judges by the robot's own links alone; the first case
of the UR5e has a forearm in its base where these are not looked at. "band": the first instant at
which a motion leaves a joint's band.
"""

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.constrained_ways import samples
from benchmarks.fcl_judge import FclJudge
from benchmarks.mbm_problems import Case, cases, panda
from benchmarks.verdict import builtin
from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.pose import transform
from kinematics.trajectory import Trajectory
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene
from planning.constrained.ik import IkOptions, constrained_ik
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.joint import JointConstraint
from planning.constraints.position import PositionConstraint
from planning.constraints.region import BoxRegion, SphereRegion
from planning.options import Options
from planning.pipeline import plan
from planning.problem import Problem
from planning.proof.certificate import certify
from planning.result import Plan

#: Problems whose box around a known way was once not kept to.
NAMED = (
    "table_under_pick_panda/scene0034",
    "table_under_pick_panda/scene0066",
    "table_under_pick_panda/scene0074",
    "cage_panda/scene0074",
)
SPARE = 5e-3
#: A region of a UR5e whose tip it brings to its base.
_CENTER, _RADIUS = (0.0, -0.2, 0.1), 0.005
#: Regions lie this near to the base [m].
_NEAR_BASE = 0.4
_ARMS = ("ur5e", "kr6_sixx", "puma560", "panda", "iiwa14", "elbow_wrist")


def tip_box(robot: RobotGeometry, way: Array) -> PositionConstraint:
    """The box around the tip's places along a way (k, n), with ``SPARE`` on each side."""
    places = np.array([forward(robot.chain, q)[:3, 3] for q in way])
    low, high = places.min(axis=0) - SPARE, places.max(axis=0) + SPARE
    return PositionConstraint(BoxRegion(transform(None, 0.5 * (low + high)), high - low))


def keep_in_box(robot: RobotGeometry, case: Case, timeout: float) -> str:
    """Plan a problem in the box around its plan without one, and judge the motion."""
    free = case.problem(robot, 0.0)
    known = plan(free, Options(timeout=timeout))
    if not isinstance(known, Plan):
        return f"no plan without a box: {known.code}"
    box = tip_box(robot, samples(known.trajectory, 2e-3))
    constraints = ConstraintSet(robot.chain, (box,))
    problem = Problem(robot, free.scene, free.start, free.goals, constraints=constraints)
    began = time.process_time()
    answer = plan(problem, Options(timeout=timeout))
    spent = 1e3 * (time.process_time() - began)
    if not isinstance(answer, Plan):
        return f"{answer.code} after {spent:.0f} ms"
    judge, region = FclJudge(robot, free.scene), box.region
    assert isinstance(region, BoxRegion)
    motion = samples(answer.trajectory, 2e-3)
    places = np.array([forward(robot.chain, q)[:3, 3] for q in motion]) - region.T[:3, 3]
    worst = float((np.abs(places @ region.T[:3, :3]) - 0.5 * np.asarray(region.size)).max())
    touching = any(judge.collides(q) for q in motion[::5])
    verdict = "violates" if worst > 1e-6 else "collides" if touching else "clean"
    return f"solved in {spent:.0f} ms, {verdict}, {1e3 * -worst:.2f} mm to spare at the worst"


def regions(robot: RobotGeometry, count: int, seed: int) -> Iterator[SphereRegion]:
    """Small regions near the base, where arms fold up, that some configuration reaches."""
    chain, random = robot.chain, np.random.default_rng(seed)
    low, high = chain.sampling_bounds()
    while count > 0:
        place = forward(chain, random.uniform(low, high))[:3, 3]
        if float(np.linalg.norm(place)) < _NEAR_BASE:
            count -= 1
            yield SphereRegion(place, 0.005)


def own_links(count: int) -> tuple[int, int, int]:
    """Constrained inverse kinematics without scenes: asked, solved, and answers that collide."""
    asked = solved = colliding = 0
    for k, name in enumerate(_ARMS):
        robot = builtin(name)
        judge = FclJudge(robot, Scene(()))
        share = count // len(_ARMS) + (k < count % len(_ARMS))
        known = [SphereRegion(np.array(_CENTER), _RADIUS)] if name == "ur5e" else []
        for region in [*known, *regions(robot, share - len(known), k)]:
            wanted = ConstraintSet(robot.chain, (PositionConstraint(region),))
            found = constrained_ik(robot, wanted, None, IkOptions(most=1))
            asked += 1
            solved += bool(found.solutions)
            colliding += any(judge.collides(np.array(s.joints)) for s in found.solutions)
    return asked, solved, colliding


def first_violation() -> tuple[float, float]:
    """The instant at which q1 = t/20 leaves joint_1 <= 0.3, as told; and as it is [s]."""
    robot = builtin("planar_rr")
    name = robot.chain.joint_names[0]
    constraints = ConstraintSet(robot.chain, (JointConstraint(name, 0.0, 0.3, 3.0),))
    line = np.array([[[0.0, 0.05], [0.0, 0.0]]])
    motion = Trajectory(robot.chain.joint_names, np.array([0.0, 10.0]), line)
    answer = certify(motion, robot, Scene(()), constraints=constraints)
    return (np.nan if answer.violation is None else answer.violation.time), 6.0


def main() -> None:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("--count", type=int, default=91, help="of inverse kinematics")
    parser.add_argument("--timeout", type=float, default=20.0)
    asked = parser.parse_args()
    robot = panda(asked.problems.parent.parent / "panda")
    for case in cases(asked.problems, robot.chain.joint_names, 1):
        if case.name in NAMED:
            print(f"tip box   {case.name}: {keep_in_box(robot, case, asked.timeout)}", flush=True)
    total, solved, colliding = own_links(asked.count)
    print(f"own links {total} asked, {solved} solved, {colliding} collide", flush=True)
    told, true = first_violation()
    print(f"band      violated from {true:g} s, told {told:.4f} s")


if __name__ == "__main__":
    main()
