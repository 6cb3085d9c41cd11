"""D(q) against pinocchio, its definition by partial Jacobians and the notes' examples."""

import numpy as np
import pytest

from dynamics.terms import augmented_mass_matrix, mass_matrix
from tests.dynamics.oracle import christoffel_function, relative_error
from tests.dynamics.samples import (
    cart_pendulum,
    planar_rr,
    random_chain,
    random_state,
)


@pytest.mark.parametrize("seed", range(4))
def test_equals_the_definition_by_partial_jacobians(seed: int) -> None:
    chain = random_chain(seed, 2 + seed)
    definition = christoffel_function(chain)
    for q in random_state(chain, seed, 5)[0]:
        expected = np.array(definition(q, np.zeros(chain.n))[0])
        assert relative_error(mass_matrix(chain, q), expected) < 1e-12


def test_motors_are_in_the_augmented_matrix_only() -> None:
    chain = random_chain(2, motors=True)
    q = random_state(chain, 0)[0]
    added = augmented_mass_matrix(chain, q) - mass_matrix(chain, q)
    np.testing.assert_allclose(added, np.broadcast_to(np.diag(chain.motor_inertia), added.shape))


def test_textbook_examples() -> None:
    m1, m2, l1, c1, c2, i1, i2 = 2.0, 1.5, 0.7, 0.3, 0.2, 0.05, 0.02
    arm = planar_rr((m1, m2), (l1, 0.5), (c1, c2), (i1, i2))
    cart = cart_pendulum(1.3, 0.4, 0.6, 0.03)
    for q in random_state(arm, 0)[0]:
        d12 = m2 * (c2**2 + l1 * c2 * np.cos(q[1])) + i2
        d11 = m1 * c1**2 + m2 * (l1**2 + c2**2 + 2 * l1 * c2 * np.cos(q[1])) + i1 + i2
        expected = [[d11, d12], [d12, i2 + m2 * c2**2]]
        np.testing.assert_allclose(mass_matrix(arm, q), expected, atol=1e-12)
        off = -0.4 * 0.6 * np.cos(q[1])
        expected = [[1.7, off], [off, 0.03 + 0.4 * 0.6**2]]
        np.testing.assert_allclose(mass_matrix(cart, q), expected, atol=1e-12)
