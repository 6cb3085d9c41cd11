"""Motions that hold constraints for every instant, judged by pinocchio's frames."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

from kinematics.arrays import Array
from kinematics.errors import InvalidGoal
from kinematics.forward import forward
from kinematics.model.chain import JointType
from kinematics.pose import transform
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.constrained.ik import IkOptions, constrained_ik
from planning.constrained.path_constraints import apply_path_constraints
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import (
    BoxRegion,
    ClearanceConstraint,
    ConeConstraint,
    Constraint,
    Geometric,
    JointConstraint,
    LineRegion,
    OrientationConstraint,
    PlaneRegion,
    PositionConstraint,
    SphereRegion,
    ToolSpeedConstraint,
    TorqueConstraint,
)
from planning.field.options import FieldOptions
from planning.field.planner import potential_field
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.planner import Ready
from planning.preflight.preflight import preflight
from planning.problem import JointGoal, PoseGoal, Problem
from planning.proof.certificate import certify
from planning.result import Failure, Plan
from planning.values.deadline import Deadline
from planning.values.optimize_options import RefineOptions
from tests.planning.dense import least_clearance, worst_ratio
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME, box, builtin, pillar, planned_motion, planning_failure

ROBOT = builtin("panda")
CHAIN = ROBOT.chain
ORACLE = PinocchioArm()
UP, DOWN = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])
UPRIGHT = ConeConstraint(UP, DOWN, np.radians(10.0))


def worst(trajectory: Trajectory, residual: Callable[[Array], float]) -> float:
    times = np.linspace(0.0, trajectory.duration, 3000)
    return max(residual(ORACLE.pose(q)) for q in trajectory.sample(times))


def at(place: list[float], *more: Geometric) -> Array:
    """A configuration with the tip at a place that holds more."""
    near = PositionConstraint(SphereRegion(place, 1e-3))
    options = IkOptions(seed_joints=HOME)
    found = constrained_ik(ROBOT, ConstraintSet(CHAIN, (near, *more)), None, options)
    return np.array(found.solutions[0].joints)


def planned(start: Array, goal: Array, scene: Scene, *constraints: Constraint) -> Plan:
    problem = Problem(
        ROBOT, scene, start, (JointGoal(goal),), constraints=ConstraintSet(CHAIN, constraints)
    )
    answer = planned_motion(problem, Options(timeout=60.0))
    assert answer.certificate.verified
    assert answer.certificate.path_constraint_residual is not None
    assert answer.certificate.path_constraint_residual <= 1e-6
    assert worst_ratio(answer.trajectory, ROBOT) <= 1.0 + 1e-9
    assert least_clearance(answer.trajectory, ROBOT, scene, problem.margin, 500) > 0.0
    np.testing.assert_allclose(answer.trajectory.end, goal, atol=1e-9)
    return answer


def tilt(T: Array) -> float:
    return float(np.arccos(np.clip(-T[2, 2], -1.0, 1.0)))


NARROW = ConeConstraint(UP, DOWN, np.radians(8.0))


def test_upright_around_a_post() -> None:
    start, goal = at([0.35, -0.35, 0.4], NARROW), at([0.35, 0.4, 0.35], NARROW)
    answer = planned(start, goal, pillar(0.1, 0.5), UPRIGHT)
    assert answer.planner == "rrt_connect"
    assert answer.timing is not None
    assert answer.timing.solver == "quintic_spline"
    # Sixteen pieces a second.
    assert answer.trajectory.pieces <= 26.0 * max(1.0, answer.trajectory.duration / 1.6)
    found = worst(answer.trajectory, tilt)
    assert found <= np.radians(10.0) + 1e-6
    (report,) = answer.certificate.path_constraints
    assert found - np.radians(10.0) <= report.residual <= 1e-6
    assert (report.constraint, report.unit, report.hard) == (0, "rad", True)


def test_in_a_thin_plane_around_a_post() -> None:
    start, goal = at([0.35, -0.35, 0.4]), at([0.35, 0.4, 0.4])
    plane = PositionConstraint(PlaneRegion([0.0, 0.0, 0.4], UP, 2e-3))
    answer = planned(start, goal, pillar(0.1, 0.5), plane)
    assert worst(answer.trajectory, lambda T: abs(T[2, 3] - 0.4)) <= 2e-3 + 1e-6
    assert answer.timing is not None
    assert answer.timing.solver in ("quintic_spline", "interior_point")


def test_along_a_line_with_a_fixed_orientation() -> None:
    R = forward(CHAIN, HOME)[:3, :3]
    fixed = OrientationConstraint(R, 0.02)
    start, goal = at([0.45, -0.2, 0.45], fixed), at([0.45, 0.25, 0.45], fixed)
    line = PositionConstraint(LineRegion([0.45, 0.0, 0.45], [0.0, 1.0, 0.0], 2e-3))
    wide = OrientationConstraint(R, 0.03)
    answer = planned(start, goal, Scene(), line, wide)
    assert worst(answer.trajectory, lambda T: float(np.hypot(T[0, 3] - 0.45, T[2, 3] - 0.45))) <= (
        2e-3 + 1e-6
    )
    assert worst(answer.trajectory, lambda T: float(np.abs(pin.log3(R.T @ T[:3, :3])).max())) <= (
        0.03 + 1e-6
    )


def test_pose_goals_and_a_soft_wish() -> None:
    start = at([0.4, -0.3, 0.4], NARROW)
    goal = PoseGoal(transform(np.diag([1.0, -1.0, -1.0]), [0.4, 0.3, 0.4]))
    wish = JointConstraint(CHAIN.joint_names[6], 0.0, 0.01, 0.01, weight=1.0)
    wanted = ConstraintSet(CHAIN, (UPRIGHT, wish))
    answer = planned_motion(
        Problem(ROBOT, Scene(), start, (goal,), constraints=wanted), Options(timeout=60)
    )
    hard, soft = answer.certificate.path_constraints
    assert (hard.hard, soft.hard) == (True, False)
    assert soft.residual > 0.0
    assert answer.certificate.path_constraint_residual == 0.0


def test_limits_of_the_motion_come_with_constraints() -> None:
    wanted = (ToolSpeedConstraint(0.2), TorqueConstraint(), ClearanceConstraint(0.03))
    problem = Problem(
        ROBOT, pillar(-1.5, 0.6), HOME, (JointGoal(HOME + 0.2),),
        constraints=ConstraintSet(CHAIN, wanted),
    )  # fmt: skip
    assert problem.margin == 0.03
    answer = planned_motion(problem, Options(timeout=60.0))
    assert answer.certificate.limits["tool_speed"].worst_ratio <= 1.0 + 1e-9
    assert answer.certificate.limits["torque"].worst_ratio <= 1.0 + 1e-9
    assert answer.certificate.path_constraint_residual is None


def failed(start: Array, goal: Array, *constraints: Constraint) -> Failure:
    wanted = ConstraintSet(CHAIN, constraints)
    return planning_failure(
        Problem(ROBOT, Scene(), start, (JointGoal(goal),), constraints=wanted), Options(timeout=30)
    )


def test_a_constraint_that_bars_the_way_is_named() -> None:
    start, goal = at([0.35, -0.35, 0.4]), at([0.35, 0.4, 0.4])
    line = PositionConstraint(LineRegion([0.35, 0.0, 0.4], [0.0, 1.0, 0.0], 5e-3))
    wall = Scene((box("wall", (0.2, 0.05, 0.3), (0.4, 0.0, 0.45)),))
    wanted = ConstraintSet(CHAIN, (line,))
    problem = Problem(ROBOT, wall, start, (JointGoal(goal),), constraints=wanted)
    answer = planning_failure(problem, Options(timeout=3.0))
    assert answer.details["constraints_that_unblock"] == [0]
    (wider,) = answer.details["relaxations"]
    assert 5e-3 < wider < 1.5
    # As much wider as is said is wide enough.
    line = PositionConstraint(LineRegion([0.35, 0.0, 0.4], [0.0, 1.0, 0.0], 5e-3 + wider))
    wanted = ConstraintSet(CHAIN, (line,))
    problem = Problem(ROBOT, wall, start, (JointGoal(goal),), constraints=wanted)
    assert isinstance(plan(problem, Options(timeout=60.0)), Plan)


@pytest.mark.parametrize("locked", [[2], [2, 4, 6]])
def test_locked_joints_stay_where_they_are_around_a_post(locked: list[int]) -> None:
    start, goal = HOME.copy(), HOME.copy()
    start += np.array([-0.8, 0.3, 0.0, 0.2, 0.3, 0.2, 0.3])
    goal += np.array([1.2, 0.3, 0.0, 0.2, 0.3, 0.2, 0.3])
    locks = [JointConstraint(CHAIN.joint_names[j], float(start[j])) for j in locked]
    answer = planned(start, goal, pillar(0.0, 0.5), *locks)
    assert answer.planner == "rrt_connect"
    times = np.linspace(0.0, answer.trajectory.duration, 500)
    moved = answer.trajectory.sample(times)
    assert np.abs(moved[:, locked] - start[locked]).max() <= 1e-9
    pose = PoseGoal(forward(CHAIN, goal), 1e-3, 1e-3)
    held = ConstraintSet(CHAIN, tuple(locks))
    reached = planned_motion(
        Problem(ROBOT, Scene(), start, (pose,), constraints=held), Options(timeout=60)
    )
    assert np.abs(reached.trajectory.end[locked] - start[locked]).max() <= 1e-9


def test_a_goal_that_turns_a_locked_joint_is_refused_by_its_name() -> None:
    goal = HOME.copy()
    goal[[0, 4]] += [0.5, 0.2]
    answer = failed(HOME, goal, JointConstraint(CHAIN.joint_names[4], float(HOME[4])))
    assert answer.code == "GOAL_VIOLATES_PATH_CONSTRAINTS"
    assert "constraint 0 (joint 'panda_joint5') by 0.2 rad" in answer.message
    assert answer.details["residual"] == pytest.approx(0.2)


def test_a_slide_is_locked_too() -> None:
    robot = builtin("stanford")
    chain = robot.chain
    low, high = chain.sampling_bounds()
    start, goal = 0.5 * (low + high), 0.5 * (low + high)
    start[[0, 1]] += [-0.8, 0.3]
    goal[[0, 1, 3]] += [0.8, 0.3, 0.5]
    slide = int(np.flatnonzero(chain.joint_types == JointType.PRISMATIC)[0])
    lock = JointConstraint(chain.joint_names[slide], float(start[slide]))
    wanted = ConstraintSet(chain, (lock,))
    reached = Problem(robot, Scene(), start, (JointGoal(goal),), constraints=wanted)
    answer = planned_motion(reached, Options(timeout=60.0))
    moved = answer.trajectory.sample(np.linspace(0.0, answer.trajectory.duration, 500))
    assert np.abs(moved[:, slide] - start[slide]).max() <= 1e-9
    goal[slide] += 0.05
    away = Problem(robot, Scene(), start, (JointGoal(goal),), constraints=wanted)
    refused = planning_failure(away, Options(timeout=60.0))
    assert refused.code == "GOAL_VIOLATES_PATH_CONSTRAINTS"
    assert "by 0.05 m" in refused.message


def test_cone_box_and_three_bands_of_joints_at_once_around_a_post() -> None:
    """All around a way that is known, with 5 mm and 5 mrad to spare."""
    start, goal = at([0.35, -0.35, 0.4], NARROW), at([0.35, 0.4, 0.35], NARROW)
    scene, spare = pillar(0.1, 0.5), 5e-3
    known = planned(start, goal, scene, UPRIGHT).trajectory
    way = known.sample(np.linspace(0.0, known.duration, 400))
    places = np.array([forward(CHAIN, q)[:3, 3] for q in way])
    low, high = places.min(axis=0) - spare, places.max(axis=0) + spare
    room = PositionConstraint(BoxRegion(transform(None, 0.5 * (low + high)), high - low))
    bands = []
    for j in (0, 3, 5):
        first, last = way[:, j].min() - spare, way[:, j].max() + spare
        half = 0.5 * (last - first)
        bands.append(JointConstraint(CHAIN.joint_names[j], 0.5 * (first + last), half, half))
    answer = planned(start, goal, scene, UPRIGHT, room, *bands)
    moved = answer.trajectory.sample(np.linspace(0.0, answer.trajectory.duration, 500))
    assert (moved[:, [0, 3, 5]] >= way[:, [0, 3, 5]].min(axis=0) - spare - 1e-6).all()
    assert (moved[:, [0, 3, 5]] <= way[:, [0, 3, 5]].max(axis=0) + spare + 1e-6).all()


def test_sets_without_thickness_are_refused() -> None:
    flat = PositionConstraint(PlaneRegion(forward(CHAIN, HOME)[:3, 3], UP, 0.0))
    with pytest.raises(InvalidGoal, match="tolerance of 0 m") as caught:
        failed(HOME, HOME, flat)
    assert "Widen" in str(caught.value.hint)


def test_a_foreign_motion_that_violates_is_told_when_and_which() -> None:
    start, goal = at([0.35, -0.35, 0.4], NARROW), at([0.35, 0.4, 0.35], NARROW)
    middle = 0.5 * (start + goal)
    middle[5] += 0.6
    rows = np.array([start, middle, goal])
    coefficients = np.stack([rows[:-1], np.diff(rows, axis=0)], axis=2)
    motion = Trajectory(CHAIN.joint_names, np.array([0.0, 1.0, 2.0]), coefficients)
    wanted = ConstraintSet(CHAIN, (UPRIGHT,))
    certificate = certify(motion, ROBOT, Scene(), constraints=wanted)
    (report,) = certificate.path_constraints
    assert not certificate.verified
    assert certificate.path_constraint_residual is not None
    assert certificate.path_constraint_residual > 0.05
    assert report.residual == certificate.path_constraint_residual


def test_a_potential_field_by_name_takes_no_step_that_leaves_a_constraint() -> None:
    start, goal = at([0.35, -0.35, 0.4], NARROW), at([0.35, 0.4, 0.35], NARROW)
    constraints = ConstraintSet(CHAIN, (UPRIGHT,))
    problem = Problem(ROBOT, Scene(), start, (JointGoal(goal),), constraints=constraints)
    ready = apply_path_constraints(problem, preflight(problem, 0), 0)
    assert isinstance(ready, Ready)
    checker = ready.checkers[-1]
    options = FieldOptions.of({"preset": "quick", "connect": False})
    deadline = Deadline.after(20.0)
    found = potential_field(ROBOT, checker, Scene(), start, [goal], options, 0, deadline)
    free = Checker(checker.model, checker.slack)
    wild = potential_field(ROBOT, free, Scene(), start, [goal], options, 0, deadline)
    assert len(found.visited) > 1
    legs = [(a, b) for a, b in pairwise(found.visited)]
    assert all(checker.free(a, b) for a, b in legs)
    shares = np.linspace(0.0, 1.0, 50)[:, None]
    for a, b in legs:
        for q in (1.0 - shares) * a + shares * b:
            assert tilt(forward(CHAIN, q)) <= np.radians(10.0) + 1e-6
    assert not all(checker.free(a, b) for a, b in pairwise(wild.visited))


def test_refinement_of_a_constrained_motion_ends_inside_its_bounds() -> None:
    """The optimiser aims a little inside: most motions get shorter, and all hold everywhere."""
    shorter = []
    for seed in range(6):
        random = np.random.default_rng(seed)
        left, right = random.uniform([0.3, -0.5, 0.3], [0.5, -0.3, 0.5], (2, 3))
        start, goal = at([*left], NARROW), at([right[0], -right[1], right[2]], NARROW)
        cone = ConstraintSet(CHAIN, (UPRIGHT,))
        problem = Problem(ROBOT, pillar(0.1, 0.5), start, (JointGoal(goal),), constraints=cone)
        before = planned_motion(problem, Options(timeout=60.0)).trajectory
        answer = planned_motion(problem, Options(timeout=60.0, refine=RefineOptions()))
        assert answer.certificate.verified
        assert worst(answer.trajectory, tilt) <= np.radians(10.0) + 1e-6
        assert worst_ratio(answer.trajectory, ROBOT) <= 1.0 + 1e-9
        shorter.append(answer.trajectory.duration < 0.97 * before.duration)
    assert sum(shorter) >= 5
