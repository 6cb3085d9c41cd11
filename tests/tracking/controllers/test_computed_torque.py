"""With an exact model the error obeys the linear equation that the gains place."""

import numpy as np
import pytest

from tests.dynamics.samples import random_chain
from tests.tracking.samples import linear_response, smooth
from tracking.controllers.computed_torque import ComputedTorque
from tracking.simulation.simulation import SimulationOptions, simulate

FINE = SimulationOptions(relative_tolerance=1e-10, absolute_tolerance=1e-12, saturate=False)


@pytest.mark.parametrize("seed", range(4))
def test_error_follows_the_placed_poles(seed: int) -> None:
    chain = random_chain(seed, 1 + seed, motors=True)
    rng = np.random.default_rng(seed)
    start, end, offset, push = rng.uniform(-1, 1, (4, chain.n))
    # From underdamped to overdamped, never exactly critical (that case is below).
    Kp, Kd = rng.uniform(20.0, 80.0, chain.n), rng.uniform(4.0, 30.0, chain.n)
    trajectory = smooth(chain, start, end)
    result = simulate(
        ComputedTorque(chain, Kp, Kd),
        trajectory,
        FINE,
        initial_position=start + 0.3 * offset,
        initial_velocity=push,
    )
    for j in range(chain.n):
        A = np.array([[0.0, 1.0], [-Kp[j], -Kd[j]]])
        x = np.array([-0.3 * offset[j], -push[j]])
        expected = linear_response(A, x, result.times)[:, 0]
        np.testing.assert_allclose(result.tracking_error[:, j], expected, atol=1e-8)


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8, 1e-10])
def test_an_exact_model_tracks_to_the_tolerance(tolerance: float) -> None:
    chain = random_chain(5, 6)
    options = SimulationOptions(
        relative_tolerance=tolerance, absolute_tolerance=tolerance, saturate=False
    )
    trajectory = smooth(chain, np.zeros(6), np.linspace(-2.0, 2.0, 6))
    result = simulate(ComputedTorque(chain, np.array(100.0), np.array(20.0)), trajectory, options)
    assert result.max_tracking_error.max() < 10.0 * tolerance
    assert result.settled
    assert result.settling_time == 0.0
