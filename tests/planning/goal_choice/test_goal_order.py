"""Choice of goal configurations: times by closed form, limits left alone, weights that decide."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.model.chain import Chain
from obstacles.scenes.scene import Scene
from planning.goal_choice.goal_order import limit_shares, order_goals
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import PoseGoal, Problem
from planning.result import Plan
from planning.timing.rest_to_rest import motion_times
from planning.values.goal_costs import GoalCosts
from tests.planning.scenes import HOME, builtin

ONLY_TIME = GoalCosts(1.0, 0.0, 0.0, 0.0, 0.0)


def panda() -> Chain:
    return builtin("panda").chain


def at_limit(share: float, joint: int = 1) -> Array:
    """HOME with a joint so far from its upper limit, as a share of its range."""
    limits, q = panda().limits, HOME.copy()
    q[joint] = limits.upper[joint] - share * (limits.upper[joint] - limits.lower[joint])
    return q


@pytest.mark.parametrize("far", [1e-3, 0.05, 0.4, 2.0])
def test_the_time_is_that_of_a_trapezoid(far: float) -> None:
    chain = panda()
    v, a = chain.limits.velocity[0], chain.limits.acceleration[0]
    speeds = np.linspace(0.0, v, 200_001)[1:]
    # Speed up to s, keep it, slow down: d = s^2/a + s t.
    times = np.where(speeds**2 / a <= far, far / speeds + speeds / a, np.inf)
    goal = HOME + np.array([far, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert motion_times(chain, HOME, goal[None])[0] == pytest.approx(times.min(), rel=1e-4)


def test_the_share_of_a_limit() -> None:
    assert limit_shares(panda(), at_limit(0.01)[None])[0] == pytest.approx(0.01)
    assert limit_shares(panda(), at_limit(-0.01)[None])[0] == pytest.approx(-0.01)


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


@pytest.mark.parametrize("seed", range(4))
def test_plans_to_poses_end_away_from_limits(seed: int) -> None:
    robot = builtin("panda")
    rng = np.random.default_rng(seed)
    target = forward(robot.chain, HOME + rng.uniform(-0.4, 0.4, 7))
    answer = plan(Problem(robot, Scene(), HOME, (PoseGoal(target),)), Options(timeout=20.0))
    assert isinstance(answer, Plan)
    assert limit_shares(robot.chain, answer.path.waypoints[-1:])[0] >= 0.02
