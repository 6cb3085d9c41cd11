"""U(q) and G(q) = grad U under another gravity."""

import numpy as np

from dynamics.terms import gravity_vector, potential_energy
from tests.dynamics.samples import (
    random_chain,
    random_state,
)


def test_gravity_can_be_replaced_and_is_linear() -> None:
    chain = random_chain(1)
    q = random_state(chain, 0)[0]
    G = gravity_vector(chain, q, [0.0, 0.0, -1.0])
    np.testing.assert_allclose(gravity_vector(chain, q, [0, 0, -3.0]), 3.0 * G, atol=1e-12)
    np.testing.assert_array_equal(potential_energy(chain, q, [0, 0, 0]), 0.0)
    assert potential_energy(chain, q[0]).shape == ()
