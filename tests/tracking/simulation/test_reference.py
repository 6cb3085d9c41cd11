"""The reference equals the trajectory's samples, piece by piece, and rests after its end."""

import numpy as np
import pytest

from kinematics.trajectory.trajectory import Trajectory
from tracking.simulation.references import ReferenceSignal


def random_trajectory(seed: int) -> Trajectory:
    rng = np.random.default_rng(seed)
    breaks = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 1.0, 5))])
    return Trajectory(("a", "b"), breaks, rng.normal(size=(5, 2, 1 + seed % 6)))


@pytest.mark.parametrize("seed", range(12))
def test_equals_the_samples_of_the_trajectory(seed: int) -> None:
    trajectory = random_trajectory(seed)
    signal = ReferenceSignal(trajectory)
    times = np.linspace(0.0, trajectory.duration, 101)[:-1]
    for t in [*times, *trajectory.breaks[:-1]]:
        got = signal.at(t)
        parts = (got.position, got.velocity, got.acceleration)
        for order, part in enumerate(parts):
            np.testing.assert_allclose(part, trajectory.sample([t], order)[0], atol=1e-12)


def test_the_piece_decides_at_a_break() -> None:
    trajectory = random_trajectory(4)
    signal = ReferenceSignal(trajectory)
    t = float(trajectory.breaks[2])
    u = t - trajectory.breaks[1]
    left = np.polynomial.polynomial.polyval(u, trajectory.coefficients[1].T)
    np.testing.assert_allclose(signal.at(t, 1).position, left, atol=1e-12)
    np.testing.assert_array_equal(signal.at(t).position, trajectory.coefficients[2, :, 0])


def test_rests_after_the_end() -> None:
    trajectory = random_trajectory(3)
    signal = ReferenceSignal(trajectory)
    for t in (trajectory.duration, trajectory.duration + 7.0):
        got = signal.at(t)
        np.testing.assert_array_equal(got.position, trajectory.end)
        np.testing.assert_array_equal(got.velocity, 0.0)
        np.testing.assert_array_equal(got.acceleration, 0.0)
    assert signal.breaks(trajectory.duration) == list(trajectory.breaks[1:-1])
    assert signal.breaks(trajectory.duration + 1.0) == list(trajectory.breaks[1:])
