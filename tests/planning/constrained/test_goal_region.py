"""Configurations of goal poses, before a search and while a tree grows, by pinocchio and FCL."""

import numpy as np
import pinocchio as pin

from kinematics.forward import forward
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.scenes.scene import Scene
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.ik import goal_configurations, pose_constraint
from planning.constrained.projected_rrt import GoalRegion
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import JointConstraint, OrientationConstraint
from planning.options import Options
from planning.problem import PoseGoal, Problem
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME, box, builtin, pillar, planned_motion

ROBOT = builtin("panda")
ORACLE = PinocchioArm()
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


def test_a_pose_that_most_configurations_collide_in_has_others() -> None:
    # Posts to both sides of the elbow leave few of the arm's configurations of this pose.
    T = forward(ROBOT.chain, HOME)
    goal = T.copy()
    goal[:3, 3] += [0.1, 0.0, -0.2]
    rng = np.random.default_rng(3)
    found = 0
    for _ in range(6):
        turns, away = rng.uniform(0.0, 2.0 * np.pi, 4), rng.uniform(0.2, 0.4, 4)
        posts = [
            box(f"post{i}", (0.04, 0.04, 1.6), (r * np.cos(t), r * np.sin(t), 0.8))
            for i, (t, r) in enumerate(zip(turns, away, strict=True))
        ]
        scene = Scene(tuple(posts))
        pose = PoseGoal(goal)
        problem = Problem(ROBOT, scene, HOME, (pose,))
        for solution in goal_configurations(problem, pose, HOME, 0):
            found += 1
            q = np.array(solution.joints)
            assert Checker.of(ROBOT, scene, 0.0).valid(q)
            np.testing.assert_allclose(forward(ROBOT.chain, q), goal, atol=1e-3)
    assert found >= 1


T = forward(ROBOT.chain, HOME)
GOAL = PoseGoal(T, position_tolerance=2e-3, orientation_tolerance=5e-3)


def errors(q: np.ndarray) -> tuple[float, float]:
    M = ORACLE.pose(q)
    turn = pin.log3(T[:3, :3].T @ M[:3, :3])
    return float(np.linalg.norm(M[:3, 3] - T[:3, 3])), float(np.linalg.norm(turn))


def test_the_constraint_is_the_largest_box_inside_the_tolerances() -> None:
    rows = pose_constraint(GOAL).rows(ROBOT.chain)
    widths = {"m": 0.0, "rad": 0.0}
    for row in rows:
        half = 0.5 * row.width if np.isfinite(row.lower) else row.width
        widths[row.unit] += half**2
    assert 0.998 * 2e-3 <= np.sqrt(widths["m"]) < 2e-3
    assert 0.998 * 5e-3 <= np.sqrt(widths["rad"]) < 5e-3


def test_configurations_are_at_the_pose_hold_constraints_and_keep_clear() -> None:
    scene = pillar(0.1, 0.7)
    problem = Problem(ROBOT, scene, HOME, (GOAL,), margin=0.02)
    name = ROBOT.chain.joint_names[0]
    solutions = goal_configurations(problem, GOAL, HOME, 0, (JointConstraint(name, 0.2, 0.1, 0.1),))
    assert solutions
    world = FclWorld(ROBOT, scene)
    for solution in solutions:
        position, orientation = errors(solution.joints)
        assert position <= GOAL.position_tolerance
        assert orientation <= GOAL.orientation_tolerance
        assert 0.1 - 1e-6 <= solution.joints[0] <= 0.3 + 1e-6
        assert world.clearance(solution.joints).distance >= 0.0
        assert solution.clearance >= 0.0
    distances = [float(np.linalg.norm(s.joints - HOME)) for s in solutions]
    assert distances == sorted(distances)
    again = goal_configurations(problem, GOAL, HOME, 0, (JointConstraint(name, 0.2, 0.1, 0.1),))
    for one, other in zip(solutions, again, strict=True):
        np.testing.assert_array_equal(one.joints, other.joints)
