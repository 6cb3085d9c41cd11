"""Which configuration of a pose a plan ends in, beside motions to others that are found apart.

Half of the poses are of configurations with a joint at its limit; among the problems are those
whose plans ended at one although another configuration was reached as soon.
"""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.robots import builtin_urdf
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import robot_geometry
from obstacles.scenes.scene import Scene
from planning.goal_choice.goal_order import MAX_LONGER_IN_BRANCH, limit_shares, order_goals
from planning.options import Options
from planning.problem import JointGoal, PoseGoal, Problem
from planning.timing.rest_to_rest import motion_times
from planning.values.preferences import GoalCosts
from tests.planning.goal_judge import judge, limit_share
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME, builtin, planned_motion


@pytest.mark.parametrize(
    ("name", "count"),
    [
        # Two turns of nearly every joint.
        ("ur5e", 8),
        # One turn and less.
        ("kr6_sixx", 4),
        # A joint to spare.
        ("iiwa14", 10),
        ("panda", 2),
        # Joints that slide; no closed form.
        ("stanford", 4),
        ("scara", 4),
    ],
)
def test_no_plan_ends_at_a_limit_where_another_configuration_takes_little_longer(
    name: str, count: int
) -> None:
    tally = judge(builtin(name), builtin_urdf(name), count, seed=0)
    assert tally.planned == count
    assert tally.broken == []


def test_joints_without_end_have_no_limit_to_be_at() -> None:
    """A UR5e whose base, first and last wrist joint turn without end."""
    urdf = builtin_urdf("ur5e")
    for joint in ("shoulder_pan_joint", "wrist_1_joint", "wrist_3_joint"):
        urdf = urdf.replace(
            f'<joint name="{joint}" type="revolute"', f'<joint name="{joint}" type="continuous"'
        )
    description = parse_urdf(urdf)
    robot = robot_geometry(serial_chain(description), description, {})
    assert robot.chain.continuous.sum() == 3
    tally = judge(robot, urdf, 6, seed=0)
    assert tally.planned == 6
    assert tally.broken == []


def test_motions_take_the_turns_that_are_near() -> None:
    """Until all turns were looked at, half of a UR5e's motions took 1.14 times as long and more."""
    tally = judge(builtin("ur5e"), builtin_urdf("ur5e"), 8, seed=1)
    assert np.median(tally.behind) < 1.02


def test_configurations_that_are_asked_for_are_kept() -> None:
    robot, at_limit = builtin("panda"), HOME.copy()
    at_limit[6] = 0.999 * robot.chain.limits.upper[6]
    problem = Problem(robot, Scene(), HOME, (JointGoal(at_limit),))
    answer = planned_motion(problem, Options(timeout=20.0))
    assert np.array_equal(answer.path.waypoints[-1], at_limit)
    assert limit_share(robot.chain, at_limit) < 0.02


ONLY_TIME = GoalCosts(1.0, 0.0, 0.0, 0.0, 0.0)


def panda() -> Chain:
    return builtin("panda").chain


def at_limit(share: float, joint: int = 1) -> Array:
    """HOME with a joint so far from its upper limit, as a share of its range."""
    limits, q = panda().limits, HOME.copy()
    q[joint] = limits.upper[joint] - share * (limits.upper[joint] - limits.lower[joint])
    return q


def test_a_configuration_at_a_limit_comes_last_where_another_is_little_slower() -> None:
    start, edge = at_limit(0.1), at_limit(0.01)
    step = edge[1] - start[1]
    for factor, first in ((1.05, "other"), (3.0, "edge")):
        other = start.copy()
        other[1] -= step * factor
        goals, best = order_goals(panda(), start, [edge, other], [0.1, 0.1], ONLY_TIME)
        assert np.array_equal(goals[0], other if first == "other" else edge)
        assert best == 1


def test_each_weight_can_decide() -> None:
    chain, start = panda(), HOME
    rng = np.random.default_rng(5)
    low, high = chain.limits.lower, chain.limits.upper
    goals = [low + (high - low) * rng.uniform(0.05, 0.95, 7) for _ in range(12)]
    clearances = list(rng.uniform(0.0, 0.06, 12))
    none = GoalCosts(0.0, 0.0, 0.0, 0.0, 0.0)
    first = {
        name: order_goals(chain, start, goals, clearances, replace(none, **{name: 1.0}))[0][0]
        for name in ("motion_time", "joint_limits", "clearance")
    }
    quickest = min(goals, key=lambda q: motion_times(chain, start, q[None])[0])
    assert np.array_equal(first["motion_time"], quickest)
    most = limit_shares(chain, np.array(goals)).max()
    assert limit_shares(chain, first["joint_limits"][None])[0] >= min(most, 0.15)
    chosen = next(k for k, q in enumerate(goals) if np.array_equal(q, first["clearance"]))
    assert clearances[chosen] >= min(max(clearances), 0.05)


#: A joint that makes each arm singular at 0, and the share of starts drawn near that.
SINGULAR = {"panda": 5, "iiwa14": 5, "ur5e": 4, "kr6_sixx": 4}
#: Steps in which the tool is led to its goal, and Newton steps in each.
STEPS, NEWTON = 30, 30


class Arm(PinocchioArm):
    """An arm that is led by its tool."""

    def led(self, q: np.ndarray, goal: np.ndarray) -> np.ndarray | None:
        """Where damped Newton steps lead the arm along the straight way; None where they fail."""
        T = self.pose(q)
        way = error(T, goal)
        for k in range(1, STEPS + 1):
            part = way * k / STEPS
            towards = np.eye(4)
            towards[:3, :3], towards[:3, 3] = pin.exp3(part[3:]) @ T[:3, :3], T[:3, 3] + part[:3]
            for _ in range(NEWTON):
                e = error(self.pose(q), towards)
                J = self.jacobian(q)
                q = q + np.clip(J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(6), e), -0.05, 0.05)
            if np.abs(error(self.pose(q), towards)).max() > 1e-6:
                return None
        return q


def error(T: np.ndarray, goal: np.ndarray) -> np.ndarray:
    return np.concatenate([goal[:3, 3] - T[:3, 3], pin.log3(goal[:3, :3] @ T[:3, :3].T)])


def small_move(arm: Arm, random: np.random.Generator, joint: int) -> tuple[np.ndarray, np.ndarray]:
    """A free start near a singularity, and a pose 5 mm and some tenths of a degree from there."""
    low, high = arm.chain.sampling_bounds()
    checker = Checker.of(builtin(arm.chain.name), Scene())
    while True:
        q = random.uniform(0.9 * low + 0.1 * high, 0.1 * low + 0.9 * high)
        q[joint] = np.clip(0.03 * random.normal(), low[joint], high[joint])
        if checker.valid(q):
            break
    goal, way, turn = arm.pose(q), random.normal(size=3), 0.01 * random.normal(size=3)
    goal[:3, 3] += 0.005 * way / np.linalg.norm(way)
    goal[:3, :3] = pin.exp3(turn) @ goal[:3, :3]
    return q, goal


@pytest.mark.parametrize("name", SINGULAR)
def test_a_small_move_never_turns_the_arm_over(name: str) -> None:
    arm, judged = Arm(name), 0
    checker, limits = Checker.of(builtin(name), Scene()), arm.chain.limits
    for seed in range(8):
        q, goal = small_move(arm, np.random.default_rng(seed), SINGULAR[name])
        own = arm.led(q, goal)
        if own is None or (own < limits.lower).any() or (own > limits.upper).any():
            continue
        if not checker.free(q, own) or min(checker.clearance(x)[0] for x in (q, own)) < 1e-3:
            continue
        problem = Problem(builtin(name), Scene(), q, (PoseGoal(goal),))
        answer = planned_motion(problem, Options(timeout=10.0))
        end = answer.trajectory.end
        least, taken = motion_times(arm.chain, q, np.array([own, end]))
        assert taken <= MAX_LONGER_IN_BRANCH * least + 1e-3, (seed, own - q, end - q)
        assert np.abs(end - q).max() <= MAX_LONGER_IN_BRANCH * np.abs(own - q).max() + 0.05
        judged += 1
    assert judged >= 3
