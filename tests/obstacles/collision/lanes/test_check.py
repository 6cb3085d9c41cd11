"""Verdicts on eight states at once are FCL's, and those on each state by itself."""

import numpy as np
import pytest

from benchmarks.verdict import builtin, clutter
from compiled.kernel import kernel
from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.collision.lanes.check import blocked_between
from obstacles.collision.model.collision_model import ModelArrays
from obstacles.collision.model.kernel_work import workspace


@kernel
def between(model: ModelArrays, a: Array, b: Array, parts: int, looks: int) -> bool:
    """``blocked_between``."""
    return blocked_between(model, workspace(model), a, b, 0.0, parts, looks)


@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize("looks", [2, 4, 16])
def test_a_motion_is_blocked_where_a_state_is_that_is_looked_at(parts: int, looks: int) -> None:
    robot = builtin("ur5e")
    random = np.random.default_rng(63)
    checker = Checker.of(robot, clutter(random, 1.2))
    lower, upper = robot.chain.sampling_bounds()
    shares = [k / looks for k in range(1, looks + (parts == 1))]
    outcomes = set()
    for _ in range(60):
        a, b = random.uniform(lower, upper, (2, robot.chain.n))
        b = a + 0.2 * (b - a)
        blocked = any(not checker.valid(a + share * (b - a)) for share in shares)
        assert between(checker.model.arrays, a, b, parts, looks) == blocked
        outcomes.add(blocked)
    assert outcomes == {True, False}
