"""D(q), its partial Jacobians and energies against pinocchio, and what they keep in motion."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from dynamics.forward import forward_dynamics
from dynamics.terms import (
    augmented_mass_matrix,
    kinetic_energy,
    mass_matrix,
    partial_jacobians,
    potential_energy,
)
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from tests.dynamics.samples import (
    cart_pendulum,
    pinocchio_model,
    planar_rr,
    random_chain,
    random_state,
)


def test_motors_are_in_the_augmented_matrix_only() -> None:
    chain = random_chain(2, motors=True)
    q = random_state(chain, 0)[0]
    added = augmented_mass_matrix(chain, q) - mass_matrix(chain, q)
    np.testing.assert_allclose(added, np.broadcast_to(np.diag(chain.motor_inertia), added.shape))


def swing(chain: Chain, duration: float) -> tuple[Array, Array]:
    """Free motion from a random state: q and q_dot, both (m, n)."""
    n = chain.n
    zero = np.zeros(n)

    def rate(_: float, x: Array) -> Array:
        return np.concatenate([x[n:], forward_dynamics(chain, x[:n], x[n:], zero)])

    start = np.random.default_rng(0).uniform(-1, 1, 2 * n)
    solution = solve_ivp(rate, (0.0, duration), start, method="DOP853", rtol=1e-12, atol=1e-12)
    return solution.y[:n].T, solution.y[n:].T


@pytest.mark.parametrize("seed", range(5))
def test_energies_equal_pinocchios(seed: int) -> None:
    chain = random_chain(seed, motors=True)
    model = pinocchio_model(chain)
    data = model.createData()
    q, qd, _ = random_state(chain, seed)
    T = kinetic_energy(chain, q, qd)
    for k in range(len(q)):
        assert T[k] == pytest.approx(pin.computeKineticEnergy(model, data, q[k], qd[k]), rel=1e-12)
        U = pin.computePotentialEnergy(model, data, q[k])
        assert potential_energy(chain, q[k]) == pytest.approx(U, rel=1e-12)


@pytest.mark.parametrize(
    "chain",
    [planar_rr(), cart_pendulum(), random_chain(11, 4), builtin_chain("stanford")],
    ids=lambda chain: chain.name,
)
def test_is_conserved_in_free_motion_over_ten_seconds(chain: Chain) -> None:
    q, qd = swing(chain, 10.0)
    E = kinetic_energy(chain, q, qd) + potential_energy(chain, q)
    spread = np.ptp(kinetic_energy(chain, q, qd))
    assert spread > 0.1
    assert np.ptp(E) < 1e-6 * spread


def test_is_spent_by_friction() -> None:
    chain = replace(random_chain(3, 3), viscous_friction=np.array([1.0, 2.0, 3.0]))
    q, qd = swing(chain, 1.0)
    E = kinetic_energy(chain, q, qd) + potential_energy(chain, q)
    assert (np.diff(E) < 0.0).all()


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
