"""Worst ratios to limits against the roots that numpy finds, for any number of joints."""

import numpy as np
import pytest

from benchmarks.judges.ratios import worst_ratio
from kinematics.trajectory.trajectory import Trajectory
from planning.timing.limit_ratios import worst_kernel


def _by_roots(breaks: np.ndarray, coefficients: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """The ratios from the eigenvalues of companion matrices."""
    names = tuple(f"joint{i}" for i in range(coefficients.shape[1]))
    motion = Trajectory(names, breaks, coefficients)
    return np.array([worst_ratio(motion, limits[row], row + 1) for row in range(3)])


@pytest.mark.parametrize("n", [1, 2, 6, 7, 8, 9, 14, 16, 17])
@pytest.mark.parametrize("size", [2, 3, 4, 6, 7])
def test_worst_ratios_are_those_at_the_roots_of_numpy(n: int, size: int) -> None:
    rng = np.random.default_rng(100 * n + size)
    for _ in range(8):
        lengths = 10.0 ** rng.uniform(-1.5, 0.5, 6)
        breaks = np.concatenate([[0.0], np.cumsum(lengths)])
        # About the same in each power at the end of a piece, so that insides count.
        scales = lengths[:, None, None] ** -np.arange(float(size))
        coefficients = rng.normal(size=(6, n, size)) * scales
        coefficients[rng.uniform(size=(6, n)) < 0.1, -1] = 0.0
        limits = 10.0 ** rng.uniform(-1.0, 1.0, (3, n))
        limits[rng.uniform(size=(3, n)) < 0.2] = np.inf
        worst = np.zeros(3)
        worst_kernel(breaks, coefficients, limits, worst)
        np.testing.assert_allclose(worst, _by_roots(breaks, coefficients, limits), rtol=1e-9)


def test_a_worst_ratio_inside_a_piece_is_found_in_every_joint() -> None:
    # The speed of (1 - u^2)^2 is 0 at both ends and 8 / sqrt(27) at u = 1 / sqrt(3).
    for n in (1, 7, 8, 12):
        for joint in range(n):
            coefficients = np.zeros((3, n, 6))
            coefficients[1, joint, :5] = [1.0, 0.0, -2.0, 0.0, 1.0]
            worst = np.zeros(3)
            worst_kernel(np.arange(4.0), coefficients, np.ones((3, n)), worst)
            np.testing.assert_allclose(worst, [8.0 / np.sqrt(27.0), 8.0, 24.0], rtol=1e-14)


def test_what_has_no_limit_is_not_looked_at() -> None:
    coefficients = np.random.default_rng(0).normal(size=(2, 3, 6))
    limits = np.full((3, 3), np.inf)
    limits[1] = 2.0
    worst = np.zeros(3)
    worst_kernel(np.arange(3.0), coefficients, limits, worst)
    assert worst[0] == worst[2] == 0.0
    assert worst[1] > 0.0
