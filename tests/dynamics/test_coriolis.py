"""C(q, q_dot) is that of the Christoffel symbols, exactly."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from dynamics.coriolis import coriolis_matrix
from kinematics.pose import transform
from tests.dynamics.oracle import christoffel_function, relative_error
from tests.dynamics.samples import (
    cart_pendulum,
    pinocchio_model,
    planar_rr,
    random_chain,
    random_state,
)


@pytest.mark.parametrize("seed", range(20))
def test_equals_pinocchio(seed: int) -> None:
    chain = random_chain(seed, 2 + seed % 8)
    model = pinocchio_model(chain)
    data = model.createData()
    q, qd, _ = random_state(chain, seed)
    C = coriolis_matrix(chain, q, qd)
    for k in range(len(q)):
        assert relative_error(C[k], pin.computeCoriolisMatrix(model, data, q[k], qd[k])) < 1e-11


@pytest.mark.parametrize("seed", range(5))
def test_equals_the_christoffel_symbols_of_the_derivatives_of_d(seed: int) -> None:
    chain = random_chain(seed, 2 + seed % 4)
    oracle = christoffel_function(chain)
    for q, qd, _ in zip(*random_state(chain, seed, 5), strict=True):
        C = coriolis_matrix(chain, q, qd)
        _, D_dot, expected, _, _ = (np.array(value) for value in oracle(q, qd))
        assert relative_error(C, expected) < 1e-11
        N = D_dot - 2.0 * C
        assert np.abs(N + N.T).max() < 1e-12 * max(1.0, np.abs(C).max())


def test_textbook_examples() -> None:
    m2, l1, c2 = 1.5, 0.7, 0.2
    arm, cart = planar_rr(), cart_pendulum()
    for q, qd, _ in zip(*random_state(arm, 0), strict=True):
        h = -m2 * l1 * c2 * np.sin(q[1])
        expected = h * np.array([[qd[1], qd[0] + qd[1]], [-qd[0], 0.0]])
        np.testing.assert_allclose(coriolis_matrix(arm, q, qd), expected, atol=1e-12)
        expected = np.array([[0.0, 0.4 * 0.6 * np.sin(q[1]) * qd[1]], [0.0, 0.0]])
        np.testing.assert_allclose(coriolis_matrix(cart, q, qd), expected, atol=1e-12)


def test_a_robot_far_from_its_base_loses_no_digits() -> None:
    chain = random_chain(7)
    offsets = chain.offsets.copy()
    offsets[0] = transform(position=[1e4, -2e4, 3e4]) @ offsets[0]
    far = replace(chain, offsets=offsets)
    q, qd, _ = random_state(chain, 0)
    assert relative_error(coriolis_matrix(far, q, qd), coriolis_matrix(chain, q, qd)) < 1e-10


def test_is_linear_in_the_velocity() -> None:
    chain = random_chain(3)
    q, qd, other = random_state(chain, 0)
    both = coriolis_matrix(chain, q, qd) + coriolis_matrix(chain, q, other)
    assert relative_error(coriolis_matrix(chain, q, qd + other), both) < 1e-12
    np.testing.assert_array_equal(coriolis_matrix(chain, q, 0.0 * qd), 0.0)
