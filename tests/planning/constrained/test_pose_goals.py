"""Configurations of goal poses, judged by pinocchio's frames and by FCL."""

import numpy as np
import pinocchio as pin

from kinematics.forward import forward
from kinematics.robots import builtin_urdf
from obstacles.collision.fcl_distance import FclWorld
from planning.constrained.pose_goals import goal_configurations, pose_constraint
from planning.constraints.kinds.joint import JointConstraint
from planning.problem import PoseGoal, Problem
from tests.planning.scenes import HOME, builtin, pillar

ROBOT = builtin("panda")
MODEL = pin.buildModelFromXML(builtin_urdf("panda"))
T = forward(ROBOT.chain, HOME)
GOAL = PoseGoal(T, position_tolerance=2e-3, orientation_tolerance=5e-3)


def errors(q: np.ndarray) -> tuple[float, float]:
    data = MODEL.createData()
    pin.framesForwardKinematics(MODEL, data, np.concatenate([q, np.zeros(MODEL.nq - 7)]))
    M = data.oMf[MODEL.getFrameId(ROBOT.chain.tip_link)]
    turn = pin.log3(T[:3, :3].T @ M.rotation)
    return float(np.linalg.norm(M.translation - T[:3, 3])), float(np.linalg.norm(turn))


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
