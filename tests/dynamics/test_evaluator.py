"""The unchecked evaluator gives what the checked functions give, state by state."""

from collections.abc import Callable

import numpy as np
import pytest

from dynamics.coriolis import coriolis_matrix
from dynamics.evaluator import DynamicsEvaluator
from dynamics.forward import forward_dynamics
from dynamics.gravity import gravity_vector
from dynamics.inverse import inverse_dynamics
from dynamics.mass_matrix import mass_matrix
from dynamics.parameters.regressor import regressor
from kinematics.arrays import Array
from kinematics.errors import InvalidRobotState
from kinematics.robots import builtin_chain
from tests.dynamics.samples import random_state


def same(told: Array, expected: Array) -> None:
    """Equal but for last digits: the same kernel compiled into two callers may round otherwise."""
    scale = max(1.0, float(np.abs(expected).max()))
    np.testing.assert_allclose(told, expected, rtol=1e-12, atol=1e-13 * scale)


@pytest.mark.parametrize("name", ["panda", "stanford", "cart_pendulum"])
def test_equals_the_checked_functions(name: str) -> None:
    chain = builtin_chain(name)
    g = [0.5, 1.0, -2.0]
    for evaluator, gravity in (
        (DynamicsEvaluator(chain), None),
        (DynamicsEvaluator(chain, g).copy(), g),
    ):
        for q, qd, qdd in zip(*random_state(chain, 0, 20), strict=True):
            same(evaluator.mass_matrix(q), mass_matrix(chain, q))
            same(evaluator.coriolis_matrix(q, qd), coriolis_matrix(chain, q, qd))
            same(evaluator.gravity(q), gravity_vector(chain, q, gravity))
            tau = inverse_dynamics(chain, q, qd, qdd, None, gravity)
            same(evaluator.inverse(q, qd, qdd), tau)
            same(evaluator.regressor(q, qd, qdd), regressor(chain, q, qd, qdd, gravity))
            same(evaluator.forward(q, qd, tau), forward_dynamics(chain, q, qd, tau, None, gravity))


def test_a_wrong_length_is_refused() -> None:
    evaluator = DynamicsEvaluator(builtin_chain("planar_rr"))
    q, long = np.zeros(2), np.zeros(3)
    calls: list[Callable[[], object]] = [
        lambda: evaluator.mass_matrix(long),
        lambda: evaluator.coriolis_matrix(q, long),
        lambda: evaluator.gravity(long),
        lambda: evaluator.inverse(q, q, long),
        lambda: evaluator.regressor(q, long, q),
        lambda: evaluator.forward(q, q, long),
    ]
    for call in calls:
        with pytest.raises(InvalidRobotState, match="3 value"):
            call()
