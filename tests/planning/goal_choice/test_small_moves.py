"""Small moves of the tool near singularities, beside the arm's own branch as pinocchio leads it."""

import numpy as np
import pinocchio as pin
import pytest

from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.goal_choice.goal_order import MAX_LONGER_IN_BRANCH
from planning.options import Options
from planning.problem import PoseGoal, Problem
from planning.timing.rest_to_rest import motion_times
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import builtin, planned_motion

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
