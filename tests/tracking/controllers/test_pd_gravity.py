"""PD with gravity compensation: V never grows for a constant reference, and the robot arrives."""

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

from tests.dynamics.samples import random_chain
from tests.tracking.samples import constant, smooth
from tracking.controllers.pd_gravity import PdGravity
from tracking.simulation.simulation import SimulationOptions, simulate

OPTIONS = SimulationOptions(duration=2.0, sample_period=2e-3, saturate=False)


@pytest.mark.parametrize("seed", range(4))
def test_lyapunov_function_never_grows(seed: int) -> None:
    chain = random_chain(seed, 2 + seed, motors=seed % 2 == 0)
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(2, chain.n, chain.n))
    Kp = 20.0 * np.eye(chain.n) + A @ A.T
    Kd = 2.0 * np.eye(chain.n) + B @ B.T
    goal, offset = rng.uniform(-1, 1, (2, chain.n))
    result = simulate(
        PdGravity(chain, Kp, Kd), constant(chain, goal), OPTIONS, initial_position=goal + offset
    )
    V, qd = result.lyapunov, result.velocity
    assert V[-1] < 0.5 * V[0]
    assert (np.diff(V) <= 1e-9 * V[0]).all()
    # V_dot = -q_dot^T (B + K_d) q_dot
    spent = np.einsum("mi,ij,mj->m", qd, Kd + np.diag(chain.viscous_friction), qd)
    total = cumulative_simpson(spent, x=result.times, initial=0.0)
    np.testing.assert_allclose(V[0] - V, total, atol=1e-4 * V[0])


def test_arrives_at_a_constant_reference() -> None:
    chain, goal = random_chain(3, 4), np.array([0.3, -0.2, 0.5, 0.1])
    options = SimulationOptions(duration=20.0, sample_period=0.1, saturate=False)
    result = simulate(
        PdGravity(chain, np.array(100.0), np.array(40.0)),
        constant(chain, goal),
        options,
        initial_position=goal + 0.5,
    )
    assert result.settled
    assert np.abs(result.tracking_error[-1]).max() < 1e-3


def test_a_moving_reference_is_followed_with_a_lag() -> None:
    chain = random_chain(3, 4)
    trajectory = smooth(chain, np.zeros(4), np.ones(4))
    options = SimulationOptions(saturate=False)
    soft, stiff = (
        simulate(PdGravity(chain, np.array(k), np.array(0.2 * k)), trajectory, options)
        for k in (100.0, 1000.0)
    )
    assert stiff.max_tracking_error.max() < 0.2 * soft.max_tracking_error.max()
    assert stiff.max_tracking_error.max() > 1e-4
