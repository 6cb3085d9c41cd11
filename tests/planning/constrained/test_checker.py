"""Edges, goals and paths under constraints, judged by pinocchio and FCL."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.scenes.scene import Scene
from planning.constrained.checker import ConstrainedChecker, narrow_rows
from planning.constrained.ik import goal_configurations
from planning.constrained.path_constraints import (
    Relaxation,
    apply_path_constraints,
    find_relaxation,
)
from planning.constrained.projected_rrt import (
    GoalRegion,
    Manifold,
    projected_rrt,
    shortcut_along,
    shortest_along,
)
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import (
    ConeConstraint,
    JointConstraint,
    OrientationConstraint,
)
from planning.constraints.row import Column
from planning.options import Options
from planning.planner import Ready
from planning.problem import JointGoal, PoseGoal, Problem
from planning.result import Failure
from planning.values.deadline import Deadline
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME, box, builtin, pillar, planned_motion
from tests.planning.slider import slider

ROBOT = builtin("panda")
CHAIN = ROBOT.chain
ORACLE = PinocchioArm()
TILT = 0.3
UPRIGHT = ConeConstraint([0.0, 0.0, 1.0], [0.0, 0.0, -1.0], TILT)


def tilt(q: Array) -> float:
    """Angle of the tool's z axis from straight down, by pinocchio [rad]."""
    return float(np.arccos(np.clip(-ORACLE.pose(q)[2, 2], -1.0, 1.0)))


def checker(scene: Scene, spare: float = 0.0, slack: float = 0.0) -> ConstrainedChecker:
    model = Checker.of(ROBOT, scene).model
    wanted = ConstraintSet(CHAIN, (UPRIGHT,))
    return ConstrainedChecker(
        model, slack, constraints=wanted, spare=np.full(len(wanted.rows), spare)
    )


def along(a: Array, b: Array, count: int = 60) -> Array:
    return np.asarray(a + np.linspace(0.0, 1.0, count)[:, None] * (b - a))


def test_an_edge_is_free_only_where_every_sample_holds() -> None:
    random, plain, held = np.random.default_rng(0), Checker.of(ROBOT, Scene()), checker(Scene())
    verdicts = []
    for _ in range(150):
        a, b = (HOME + random.uniform(-0.25, 0.25, 7) for _ in range(2))
        worst = max(tilt(q) for q in along(a, b))
        free = held.free(a, b)
        motion = held.segment(a, b)
        assert motion.free is held.straight(a, b).free is free
        if free:
            assert worst <= TILT + 1e-6
            assert plain.free(a, b)
        else:
            # What is left out holds nowhere near the bound, or collides.
            assert worst > 0.9 * TILT or not plain.free(a, b)
            assert motion.pair is not None
        verdicts.append(free)
    assert 20 < sum(verdicts) < 130


def test_a_curve_that_leaves_the_set_between_its_ends_is_refused_and_told() -> None:
    """q6 goes out and back as 4 s (1 - s): both ends hold, the middle does not."""
    held, bend = checker(Scene()), np.zeros(7)
    bend[5] = 1.5 * TILT
    motion = held.curve(HOME, 4.0 * bend, -4.0 * bend)
    assert not motion.free
    assert not motion.colliding
    assert motion.pair is not None
    assert "constraint 0" in motion.pair[1]
    assert motion.at == pytest.approx(0.5, abs=0.2)
    assert held.curve(HOME, 0.5 * 4.0 * bend, -0.5 * 4.0 * bend).free


def test_what_holds_but_collides_is_not_free() -> None:
    """The base turns the tool about the vertical: it stays upright and meets the post."""
    start, goal = HOME.copy(), HOME.copy()
    start[0], goal[0] = -0.8, 0.8
    assert checker(Scene()).free(start, goal)
    barred = checker(pillar(0.0, 0.4))
    assert not barred.free(start, goal)
    motion = barred.segment(start, goal)
    assert motion.colliding
    assert motion.pair is not None
    assert motion.pair[1] == "post"


def test_a_polyline_names_the_first_leg_that_leaves_the_set() -> None:
    tilted = HOME.copy()
    tilted[5] += 2.0 * TILT
    aside = HOME + np.array([0.3, 0, 0, 0, 0, 0, 0])
    held = checker(Scene())
    motion, leg = held.polyline(np.array([HOME, aside, tilted, HOME]))
    assert (motion.free, leg) == (False, 1)
    motion, leg = held.polyline(np.array([HOME, aside, HOME]))
    assert motion.free
    assert all(held.free(a, b) for a, b in pairwise([HOME, aside, HOME]))


def test_half_of_what_the_ends_have_to_spare_is_kept_back_at_most() -> None:
    """Two milliradians of the cone's 0.3 are kept back where start and goal have them to spare."""
    for share, spare in ((0.998, 0.0), (0.998, 1.0), (0.99, 1.0)):
        q = HOME.copy()
        for _ in range(5):
            q[5] += share * TILT - tilt(q)
        assert tilt(q) == pytest.approx(share * TILT, abs=1e-5)
        narrow = spare > 0.0 and share > 0.995
        assert checker(Scene(), spare).free(q, q + np.eye(7)[0] * 1e-3) is not narrow


def test_rows_are_narrowed_on_both_sides_and_at_most_by_what_is_said() -> None:
    wanted = ConstraintSet(CHAIN, (UPRIGHT, JointConstraint(CHAIN.joint_names[0], 0.5, 0.1, 0.3)))
    true = np.array(wanted.packed)
    two_sided = np.isfinite(true[:, Column.LOWER])
    assert two_sided.any()
    assert not two_sided.all()
    half = np.where(
        two_sided, 0.5 * (true[:, Column.UPPER] - true[:, Column.LOWER]), true[:, Column.UPPER]
    )
    for share in (0.0, 0.05, 0.5, 1.0):
        rows = narrow_rows(wanted, share)
        np.testing.assert_allclose(
            true[:, Column.UPPER] - rows[:, Column.UPPER], share * half, atol=1e-15
        )
        inwards = rows[two_sided, Column.LOWER] - true[two_sided, Column.LOWER]
        np.testing.assert_allclose(inwards, (share * half)[two_sided], atol=1e-15)
        assert (rows[two_sided, Column.LOWER] <= rows[two_sided, Column.UPPER] + 1e-15).all()
    capped = narrow_rows(wanted, 0.5, 0.01)
    np.testing.assert_allclose(true[:, Column.UPPER] - capped[:, Column.UPPER], 0.01, atol=1e-15)
    np.testing.assert_array_equal(narrow_rows(wanted, 0.5, -1.0), true)
    np.testing.assert_array_equal(np.array(wanted.packed), true)


def test_a_cubic_is_held_to_the_rows_by_all_of_its_powers() -> None:
    """q6 goes out, back and out again the other way: s (1 - s) (1 - 2 s)."""
    held, bend, none = checker(Scene()), np.zeros(7), np.zeros(7)
    bend[5] = 12.0 * TILT
    powers = bend, -3.0 * bend, 2.0 * bend
    largest = 12.0 * TILT / (6.0 * np.sqrt(3.0))
    assert largest > 1.1 * TILT
    assert not held.curve(HOME, *powers).free
    assert held.curve(HOME, *(0.8 * power for power in powers)).free
    assert not held.curve(HOME, none, none, 0.2 * bend).free
    assert held.curve(HOME, none, none, 0.05 * bend).free


def test_the_row_that_is_violated_most_is_named() -> None:
    names = CHAIN.joint_names
    near = [JointConstraint(names[j], float(HOME[j]), 0.2, 0.2) for j in (0, 2)]
    wanted = ConstraintSet(CHAIN, tuple(near))
    model = Checker.of(ROBOT, Scene()).model
    held = ConstrainedChecker(model, 0.0, constraints=wanted, spare=np.zeros(2))
    for joint, number in ((0, 0), (2, 1)):
        motion = held.segment(HOME, HOME + 0.5 * np.eye(7)[joint])
        assert motion.pair == (CHAIN.tip_link, wanted.label(number))
        assert motion.at == 1.0


SLIDER = slider().chain
BEGIN = np.array([-0.5, 0.0])


def band(middle: float, half: float, weight: float | None = None) -> ConstraintSet:
    """The second slide stays within ``half`` of a middle."""
    return ConstraintSet(SLIDER, (JointConstraint("jy", middle, half, half, weight=weight),))


def applied(
    constraints: ConstraintSet | None, *goals: tuple[float, float]
) -> tuple[Ready, Ready | Failure]:
    ends = [np.array(goal) for goal in goals]
    joints = tuple(JointGoal(q) for q in ends)
    problem = Problem(slider(), Scene(), BEGIN, joints, constraints=constraints)
    ready = Ready(BEGIN, ends, (Checker.of(slider(), Scene()),), ("a note",))
    return ready, apply_path_constraints(problem, ready, 0)


def test_goals_that_violate_are_left_out_and_the_checker_knows_the_constraints() -> None:
    _, answer = applied(band(0.0, 0.1), (0.5, 0.3), (0.5, 0.05), (0.2, -0.4))
    assert isinstance(answer, Ready)
    (goal,) = answer.goals
    np.testing.assert_array_equal(goal, [0.5, 0.05])
    assert answer.notes == ("a note",)
    (checker,) = answer.checkers
    assert isinstance(checker, ConstrainedChecker)
    assert checker.free(BEGIN, goal)
    assert not checker.free(BEGIN, np.array([0.5, 0.3]))
    # Of the goal's 5 cm to spare two millimetres are kept back.
    assert checker.free(BEGIN, np.array([0.5, 0.0979]))
    assert not checker.free(BEGIN, np.array([0.5, 0.0981]))


START, GOAL = np.array([-0.5, 0.0]), np.array([0.5, 0.0])
#: A wall that ends at y = 0.2: the ball of 5 cm gets round it at y > 0.25.
WALL = Scene((box("wall", (0.1, 0.8, 0.4), (0.0, -0.2, 0.0)),))
BAND = JointConstraint("jy", 0.0, 0.1, 0.1)
WIDE = JointConstraint("jx", 0.0, 0.8, 0.8)


def relaxation(scene: Scene, *constraints: JointConstraint, seconds: float = 1.5) -> Relaxation:
    hard = ConstraintSet(SLIDER, constraints)
    model = Checker.of(slider(), scene).model
    checker = ConstrainedChecker(model, 0.0, constraints=hard, spare=np.zeros(len(hard.rows)))
    return find_relaxation(checker, START, [GOAL], 0, Deadline.after(seconds))


def test_the_constraint_that_bars_the_way_is_named_with_what_it_lacks() -> None:
    answer = relaxation(WALL, BAND, WIDE)
    assert answer.constraints == (0,)
    # Past the wall's end 25 cm up, of which the constraint allows 10.
    assert 0.15 <= answer.wider[0] <= 0.95
    assert answer.units == ("m",)
    assert "widened" in answer.sentence
    assert answer.details["constraints_that_unblock"] == [0]
    assert answer.details["way_without_obstacles"] is True
    assert "Without the obstacles there is a way." in answer.sentence


def test_it_says_where_obstacles_are_not_to_blame() -> None:
    answer = relaxation(WALL, JointConstraint("jy", 0.6, 0.1, 0.1), WIDE, seconds=2.0)
    assert answer.constraints == (0,)
    assert answer.without_obstacles is False
    assert "Without the obstacles no way was found either." in answer.sentence


TURN = 0.05


def test_goals_near_what_was_reached() -> None:
    T = forward(ROBOT.chain, HOME)
    held = ConstraintSet(ROBOT.chain, (OrientationConstraint(T[:3, :3], TURN),))
    scene = pillar(0.1, 0.5)
    model = Checker.of(ROBOT, scene, 0.0)
    checker = ConstrainedChecker(model.model, model.slack, constraints=held, spare=np.zeros(3))
    first, second = T.copy(), T.copy()
    first[:3, 3] += [0.05, 0.2, 0.0]
    second[:3, 3] += [0.1, -0.2, 0.1]
    poses = PoseGoal(first), PoseGoal(second)
    region = GoalRegion(checker, poses)
    rng, found = np.random.default_rng(0), 0
    for k in range(60):
        near = HOME + rng.normal(scale=0.15, size=7)
        q = region.goal_near(near, k)
        if q is None:
            continue
        found += 1
        pose = poses[k % 2]
        M = ORACLE.pose(q)
        off = np.linalg.norm(M[:3, 3] - pose.T_base_tip[:3, 3])
        assert off <= pose.position_tolerance
        turned = np.linalg.norm(pin.log3(pose.T_base_tip[:3, :3].T @ M[:3, :3]))
        assert turned <= pose.orientation_tolerance
        assert checker.valid(q)
        # Newton's method goes to a configuration nearby, not to another branch.
        assert np.abs(q - near).max() < 1.5
    assert found >= 30


def test_a_branch_that_the_start_is_not_in_keeps_no_pose_from_being_reached() -> None:
    # The elbow and wrist are such that most configurations of the goal lie in other branches.
    start = np.array([-0.27, -0.97, 0.31, -2.62, 2.11, 2.84, 2.01])
    T = forward(ROBOT.chain, start)
    goal = T.copy()
    goal[:3, 3] += [0.25, -0.2, 0.1]
    held = ConstraintSet(ROBOT.chain, (OrientationConstraint(T[:3, :3], TURN),))
    for seed in range(3):
        problem = Problem(ROBOT, Scene(()), start, (PoseGoal(goal),), constraints=held)
        answer = planned_motion(problem, Options(timeout=30.0, seed=seed))
        reached = forward(ROBOT.chain, answer.trajectory.end)
        np.testing.assert_allclose(reached, goal, atol=1e-3)
        assert answer.certificate.path_constraint_residual == 0.0


T = forward(ROBOT.chain, HOME)
GOAL_REGION_GOAL = PoseGoal(T, position_tolerance=2e-3, orientation_tolerance=5e-3)


def errors(q: np.ndarray) -> tuple[float, float]:
    M = ORACLE.pose(q)
    turn = pin.log3(T[:3, :3].T @ M[:3, :3])
    return float(np.linalg.norm(M[:3, 3] - T[:3, 3])), float(np.linalg.norm(turn))


def test_configurations_are_at_the_pose_hold_constraints_and_keep_clear() -> None:
    scene = pillar(0.1, 0.7)
    problem = Problem(ROBOT, scene, HOME, (GOAL_REGION_GOAL,), margin=0.02)
    name = ROBOT.chain.joint_names[0]
    solutions = goal_configurations(
        problem, GOAL_REGION_GOAL, HOME, 0, (JointConstraint(name, 0.2, 0.1, 0.1),)
    )
    assert solutions
    world = FclWorld(ROBOT, scene)
    for solution in solutions:
        position, orientation = errors(solution.joints)
        assert position <= GOAL_REGION_GOAL.position_tolerance
        assert orientation <= GOAL_REGION_GOAL.orientation_tolerance
        assert 0.1 - 1e-6 <= solution.joints[0] <= 0.3 + 1e-6
        assert world.clearance(solution.joints).distance >= 0.0
        assert solution.clearance >= 0.0
    distances = [float(np.linalg.norm(s.joints - HOME)) for s in solutions]
    assert distances == sorted(distances)
    again = goal_configurations(
        problem, GOAL_REGION_GOAL, HOME, 0, (JointConstraint(name, 0.2, 0.1, 0.1),)
    )
    for one, other in zip(solutions, again, strict=True):
        np.testing.assert_array_equal(one.joints, other.joints)


def test_paths_that_wander_are_made_shorter_and_stay_proved() -> None:
    """Every leg of what comes back holds by pinocchio; those that wander lose a tenth together."""
    manifold = Manifold(checker(pillar(0.1, 0.5)))
    random, found, short = np.random.default_rng(4), list[float](), list[float]()
    deadline = Deadline.after(60.0)
    for seed in range(28):
        ends = list[Array]()
        while len(ends) < 2:
            q = manifold.project(random.uniform(*CHAIN.sampling_bounds()))
            if q is not None and manifold.checker.valid(q):
                ends.append(q)
        path, _ = projected_rrt(manifold, ends[0], [ends[1]], seed, deadline, max_extensions=400)
        if path is None:
            continue
        before = shortcut_along(manifold, path, seed, deadline)
        after = shortest_along(manifold, path, seed, deadline)
        np.testing.assert_array_equal(after[[0, -1]], path[[0, -1]])
        for a, b in pairwise(after):
            assert manifold.checker.free(a, b)
            assert max(tilt(q) for q in along(a, b, 20)) <= TILT + 1e-9
        length, shorter = (
            np.linalg.norm(np.diff(p, axis=0), axis=1).sum() for p in (before, after)
        )
        assert shorter <= length + 1e-12
        if length > 1.3 * np.linalg.norm(path[-1] - path[0]):
            found.append(length)
            short.append(shorter)
    assert len(found) >= 5
    assert sum(short) < 0.9 * sum(found)
