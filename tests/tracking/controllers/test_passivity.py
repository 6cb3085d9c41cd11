"""Passivity-based control: V falls as the proof says along a moving reference."""

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

from tests.dynamics.samples import random_chain
from tests.tracking.samples import smooth
from tracking.controllers.gain import commute
from tracking.controllers.model_based import Passivity
from tracking.simulation.simulation import SimulationOptions, simulate


@pytest.mark.parametrize("seed", range(4))
def test_lyapunov_function_falls_as_its_derivative_says(seed: int) -> None:
    chain = random_chain(seed, 2 + seed, motors=seed % 2 == 0)
    rng = np.random.default_rng(seed)
    start, end, offset = rng.uniform(-1, 1, (3, chain.n))
    Lambda, K = rng.uniform(2.0, 6.0, chain.n), rng.uniform(3.0, 9.0, chain.n)
    result = simulate(
        Passivity(chain, Lambda, K),
        smooth(chain, start, end, 1.5),
        SimulationOptions(sample_period=1e-3, saturate=False),
        initial_position=start + 0.5 * offset,
    )
    V = result.lyapunov
    e, e_dot = result.tracking_error, result.reference_velocity - result.velocity
    assert (np.diff(V) <= 1e-9 * V[0]).all()
    assert V[-1] < V[0]
    spent = (K * e_dot**2).sum(axis=1) + (K * (Lambda * e) ** 2).sum(axis=1)
    total = cumulative_simpson(spent, x=result.times, initial=0.0)
    np.testing.assert_allclose(V[0] - V, total, atol=1e-5 * V[0])


def test_an_exact_model_tracks_to_the_tolerance() -> None:
    chain = random_chain(5, 6, motors=True)
    trajectory = smooth(chain, np.zeros(6), np.linspace(-2.0, 2.0, 6))
    result = simulate(
        Passivity(chain, np.array(5.0), np.array(10.0)),
        trajectory,
        SimulationOptions(saturate=False),
    )
    assert result.max_tracking_error.max() < 1e-7


def test_k_commutes_with_lambda_where_it_couples_joints_of_equal_lambda() -> None:
    K = np.array([[3.0, 1.0, 0.0], [1.0, 3.0, 0.0], [0.0, 0.0, 2.0]])
    assert commute(np.array([2.0, 2.0, 5.0]), K)
    assert not commute(np.array([2.0, 3.0, 5.0]), K)
