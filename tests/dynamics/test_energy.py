"""Energy is conserved without friction, and spent with it."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from dynamics.forward import forward_dynamics
from dynamics.terms import kinetic_energy, total_energy
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
def test_kinetic_energy_equals_pinocchio(seed: int) -> None:
    chain = random_chain(seed, motors=True)
    model = pinocchio_model(chain)
    data = model.createData()
    q, qd, _ = random_state(chain, seed)
    T = kinetic_energy(chain, q, qd)
    for k in range(len(q)):
        assert T[k] == pytest.approx(pin.computeKineticEnergy(model, data, q[k], qd[k]), rel=1e-12)


@pytest.mark.parametrize(
    "chain",
    [planar_rr(), cart_pendulum(), random_chain(11, 4), builtin_chain("stanford")],
    ids=lambda chain: chain.name,
)
def test_is_conserved_in_free_motion_over_ten_seconds(chain: Chain) -> None:
    q, qd = swing(chain, 10.0)
    E = total_energy(chain, q, qd)
    spread = np.ptp(kinetic_energy(chain, q, qd))
    assert spread > 0.1
    assert np.ptp(E) < 1e-6 * spread


def test_is_spent_by_friction() -> None:
    chain = replace(random_chain(3, 3), viscous_friction=np.array([1.0, 2.0, 3.0]))
    E = total_energy(chain, *swing(chain, 1.0))
    assert (np.diff(E) < 0.0).all()
