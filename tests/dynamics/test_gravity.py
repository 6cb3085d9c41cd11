"""U(q) and G(q) = grad U against pinocchio and automatic derivatives."""

import numpy as np
import pytest

from dynamics.terms import gravity_vector, potential_energy
from tests.dynamics.oracle import christoffel_function, relative_error
from tests.dynamics.samples import (
    cart_pendulum,
    planar_rr,
    random_chain,
    random_state,
)


@pytest.mark.parametrize("seed", range(4))
def test_is_the_gradient_of_the_potential(seed: int) -> None:
    chain = random_chain(seed, 2 + seed)
    oracle = christoffel_function(chain)
    for q in random_state(chain, seed, 5)[0]:
        U, gradient = oracle(q, np.zeros(chain.n))[3:]
        assert relative_error(gravity_vector(chain, q), np.array(gradient)[:, 0]) < 1e-12
        assert potential_energy(chain, q) == pytest.approx(float(U), rel=1e-12)


def test_textbook_examples() -> None:
    arm, cart, g = planar_rr(), cart_pendulum(), 9.81
    for q in random_state(arm, 0)[0]:
        g2 = 1.5 * 0.2 * g * np.cos(q[0] + q[1])
        expected = [(2.0 * 0.3 + 1.5 * 0.7) * g * np.cos(q[0]) + g2, g2]
        np.testing.assert_allclose(gravity_vector(arm, q), expected, atol=1e-12)
        # The scanned notes print a cosine here; U = m_2 g l cos(phi) says sine.
        expected = [0.0, -0.4 * 0.6 * g * np.sin(q[1])]
        np.testing.assert_allclose(gravity_vector(cart, q), expected, atol=1e-12)
        assert potential_energy(cart, q) == pytest.approx(0.4 * 0.6 * g * np.cos(q[1]), abs=1e-12)


def test_gravity_can_be_replaced_and_is_linear() -> None:
    chain = random_chain(1)
    q = random_state(chain, 0)[0]
    G = gravity_vector(chain, q, [0.0, 0.0, -1.0])
    np.testing.assert_allclose(gravity_vector(chain, q, [0, 0, -3.0]), 3.0 * G, atol=1e-12)
    np.testing.assert_array_equal(potential_energy(chain, q, [0, 0, 0]), 0.0)
    assert potential_energy(chain, q[0]).shape == ()
