"""The search for one pose: its table, what weighs how much, and where it gives up."""

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.numeric.numeric import SearchOptions, solve
from kinematics.model.chain import Chain
from kinematics.pose import rotation_error, rotation_z, transform
from kinematics.robots import builtin_chain

# ----------------------------------------------------------------------------------- by the door


def pose_of(chain: Chain, seed: int) -> tuple[Array, Array]:
    """A configuration well inside the limits and its pose."""
    lower, upper = chain.sampling_bounds()
    q = np.random.default_rng(seed).uniform(0.7 * lower, 0.7 * upper)
    return q, forward(chain, q)


def test_a_start_at_the_goal_costs_no_step() -> None:
    chain = builtin_chain("panda")
    q, T = pose_of(chain, 2)
    result = solve(chain, T, seed_joints=q)
    assert result.solutions[0].iterations == 0
    assert result.starts == 1
    np.testing.assert_array_equal(result.solutions[0].joints, q)


def test_a_start_near_the_goal_takes_a_few_steps_and_no_restart() -> None:
    chain = builtin_chain("panda")
    q, T = pose_of(chain, 3)
    result = solve(chain, T, seed_joints=q + 0.01)
    assert result.starts == 1
    assert 1 <= result.solutions[0].iterations <= 10
    assert np.abs(result.solutions[0].joints - q).max() < 0.1


@pytest.mark.parametrize("starts", [1, 2, 7])
def test_no_more_starts_are_spent_than_allowed(starts: int) -> None:
    chain = builtin_chain("ur5e")
    result = solve(chain, transform(None, [9.0, 0.0, 0.0]), SearchOptions(starts=starts))
    assert result.solutions == ()
    assert result.starts == starts


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
def test_a_solution_is_as_good_as_asked_for_and_tells_its_errors(tolerance: float) -> None:
    chain = builtin_chain("iiwa14")
    options = SearchOptions(position_tolerance=tolerance, orientation_tolerance=10 * tolerance)
    for seed in range(4):
        _, T = pose_of(chain, seed)
        solution = solve(chain, T, options).solutions[0]
        reached = forward(chain, solution.joints)
        away = float(np.linalg.norm(reached[:3, 3] - T[:3, 3]))
        turn = float(np.linalg.norm(rotation_error(reached[:3, :3], T[:3, :3])))
        assert away <= tolerance
        assert turn <= 10 * tolerance
        assert solution.position_error == pytest.approx(away, abs=1e-13)
        assert solution.orientation_error == pytest.approx(turn, abs=1e-13)


@pytest.mark.parametrize("turned", [0.5, 2.0, 3.1])
def test_a_turn_that_does_not_count_does_not_matter(turned: float) -> None:
    chain = builtin_chain("ur5e")
    q, T = pose_of(chain, 5)
    options = SearchOptions(axes=("x", "y", "z", "rx", "ry"))
    result = solve(chain, T @ transform(rotation_z(turned)), options, seed_joints=q)
    np.testing.assert_array_equal(result.solutions[0].joints, q)
