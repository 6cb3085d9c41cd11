"""Partial Jacobians of the bodies, against pinocchio and the mass matrix."""

import numpy as np
import pinocchio as pin
import pytest

from dynamics.terms import partial_jacobians
from tests.dynamics.samples import pinocchio_model, planar_rr, random_chain, random_state


@pytest.mark.parametrize("seed", range(8))
def test_equals_pinocchio_and_makes_the_mass_matrix(seed: int) -> None:
    chain = random_chain(seed, 2 + seed % 5)
    model = pinocchio_model(chain)
    data = model.createData()
    q = random_state(chain, seed, 4)[0]
    linear, angular = partial_jacobians(chain, q)
    assert linear.shape == angular.shape == (4, chain.n, 3, chain.n)
    for k, at in enumerate(q):
        pin.computeJointJacobians(model, data, at)
        D = np.zeros((chain.n, chain.n))
        for i in range(chain.n):
            J = pin.getJointJacobian(model, data, i + 1, pin.LOCAL_WORLD_ALIGNED)
            body, R = model.inertias[i + 1], data.oMi[i + 1].rotation
            at_center = J[:3] - pin.skew(R @ body.lever) @ J[3:]
            np.testing.assert_allclose(linear[k, i], at_center, atol=1e-12)
            np.testing.assert_allclose(angular[k, i], J[3:], atol=1e-12)
            D += body.mass * linear[k, i].T @ linear[k, i]
            D += angular[k, i].T @ R @ body.inertia @ R.T @ angular[k, i]
        M = pin.crba(model, data, at)
        np.testing.assert_allclose(np.triu(D), np.triu(M), atol=1e-11)


def test_the_notes_planar_arm() -> None:
    chain = planar_rr(lengths=(0.7, 0.5), centers=(0.3, 0.2))
    linear, angular = partial_jacobians(chain, [0.0, np.pi / 2])
    np.testing.assert_allclose(linear[0], [[0.0, 0.0], [0.3, 0.0], [0.0, 0.0]], atol=1e-15)
    np.testing.assert_allclose(linear[1], [[-0.2, -0.2], [0.7, 0.0], [0.0, 0.0]], atol=1e-15)
    np.testing.assert_allclose(angular[1], [[0, 0], [0, 0], [1, 1]], atol=1e-15)
