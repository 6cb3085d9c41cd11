"""C(q, q_dot) is that of the Christoffel symbols, exactly."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from dynamics.terms import christoffel_symbols, coriolis_matrix
from kinematics.pose import transform
from tests.dynamics.samples import (
    pinocchio_model,
    random_chain,
    random_state,
    relative_error,
)


def test_a_robot_far_from_its_base_loses_no_digits() -> None:
    chain = random_chain(7)
    offsets = chain.offsets.copy()
    offsets[0] = transform(position=[1e4, -2e4, 3e4]) @ offsets[0]
    far = replace(chain, offsets=offsets)
    q, qd, _ = random_state(chain, 0)
    assert relative_error(coriolis_matrix(far, q, qd), coriolis_matrix(chain, q, qd)) < 1e-10


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
