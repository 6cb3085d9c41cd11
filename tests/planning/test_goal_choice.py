"""Which configuration of a pose a plan ends in, beside motions to the others by themselves."""

import numpy as np
import pytest

from kinematics.forward import forward
from obstacles.checker import Checker
from obstacles.scene import Scene
from planning.goal_costs import GoalCosts
from planning.options import Options
from planning.pipeline import plan
from planning.preflight.goal_order import limit_share
from planning.preflight.preflight import preflight
from planning.problem import JointGoal, PoseGoal, Problem
from planning.ready import Ready
from planning.result import Plan
from tests.planning.scenes import builtin

OPTIONS = Options(timeout=60.0)


@pytest.mark.parametrize("arm", ["kr6_sixx", "ur5e", "panda"])
def test_no_plan_ends_at_a_limit_where_another_configuration_takes_little_longer(arm: str) -> None:
    """Half of the poses are of configurations with a joint at its limit."""
    robot, random = builtin(arm), np.random.default_rng(3)
    chain, checker = robot.chain, Checker.of(robot, Scene())
    low, high = chain.sampling_bounds()
    count = 0
    while count < 4:
        start, goal = random.uniform(low, high, (2, chain.n))
        if count % 2:
            joint = int(random.integers(chain.n))
            goal[joint] = high[joint] - 0.01 * random.random() * (high[joint] - low[joint])
        if not (checker.valid(start) and checker.valid(goal)):
            continue
        count += 1
        problem = Problem(robot, Scene(), start, (PoseGoal(forward(chain, goal)),))
        answer = plan(problem, OPTIONS)
        assert isinstance(answer, Plan)
        if limit_share(chain, answer.path.waypoints[-1]) >= 0.02:
            continue
        ready = preflight(problem, 0, None, GoalCosts())
        assert isinstance(ready, Ready)
        for other in ready.goals:
            if limit_share(chain, other) >= 0.02:
                motion = plan(Problem(robot, Scene(), start, (JointGoal(other),)), OPTIONS)
                assert isinstance(motion, Plan)
                assert motion.trajectory.duration > 1.2 * answer.trajectory.duration
