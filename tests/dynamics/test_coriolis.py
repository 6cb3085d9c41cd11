"""C(q, q_dot) is that of the Christoffel symbols, exactly."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from dynamics.terms import christoffel_symbols, coriolis_matrix
from kinematics.pose import transform
from tests.dynamics.oracle import christoffel_function, relative_error
from tests.dynamics.samples import (
    cart_pendulum,
    pinocchio_model,
    planar_rr,
    random_chain,
    random_state,
)


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


def test_christoffel_symbols_are_those_of_the_notes_planar_arm() -> None:
    chain = planar_rr(masses=(2.0, 1.5), lengths=(0.7, 0.5), centers=(0.3, 0.2))
    q = np.array([0.4, -1.1])
    h = -1.5 * 0.7 * 0.2 * np.sin(q[1])
    expected = np.zeros((2, 2, 2))
    expected[0, 1, 0] = expected[1, 0, 0] = expected[1, 1, 0] = h
    expected[0, 0, 1] = -h
    np.testing.assert_allclose(christoffel_symbols(chain, q), expected, atol=1e-15)


@pytest.mark.parametrize("seed", range(3))
def test_christoffel_symbols_are_derivatives_of_the_mass_matrix(seed: int) -> None:
    chain = random_chain(seed, 4)
    q, qd, _ = random_state(chain, seed, 6)
    symbols = christoffel_symbols(chain, q)
    assert symbols.shape == (6, 4, 4, 4)
    np.testing.assert_allclose(symbols, np.swapaxes(symbols, 1, 2), atol=1e-12)
    C = np.einsum("mijk,mi->mkj", symbols, qd)
    np.testing.assert_allclose(C, coriolis_matrix(chain, q, qd), atol=1e-11)
    model, step = pinocchio_model(chain), 1e-6

    def mass(at: np.ndarray) -> np.ndarray:
        upper = np.triu(pin.crba(model, model.createData(), at))
        return np.asarray(upper + np.triu(upper, 1).T)

    for at, c in zip(q, symbols, strict=True):
        ends = [(mass(at + step * e), mass(at - step * e)) for e in np.eye(4)]
        # d[m, i, j] is the derivative of d_ij with respect to q_m.
        d = np.array([(after - before) / (2.0 * step) for after, before in ends])
        first, second = np.einsum("ikj->ijk", d), np.einsum("jki->ijk", d)
        np.testing.assert_allclose(c, 0.5 * (first + second - np.einsum("kij->ijk", d)), atol=1e-7)
