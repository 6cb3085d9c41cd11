"""Banded systems against scipy's solver."""

import numpy as np
from scipy.linalg import solveh_banded

from planning.timing.jerk.banded_cholesky import solve_banded_kernel, solve_wide_band_kernel


def test_solutions_are_those_of_scipy() -> None:
    rng = np.random.default_rng(0)
    for size in (1, 2, 3, 10, 200):
        band = np.zeros((size, 3))
        band[:, 0] = rng.uniform(3.0, 4.0, size)
        band[1:, 1] = rng.uniform(-1.0, 1.0, max(size - 1, 0))
        band[2:, 2] = rng.uniform(-0.5, 0.5, max(size - 2, 0))
        right = rng.normal(size=size)
        # scipy stores column by column: entry (i, i - k) stands at [k, i - k].
        lower = np.zeros((3, size))
        for k in range(min(3, size)):
            lower[k, : size - k] = band[k:, k]
        expected = solveh_banded(lower[: min(3, size)], right, lower=True)
        answer = right.copy()
        assert solve_banded_kernel(band.copy(), answer)
        np.testing.assert_allclose(answer, expected, rtol=1e-12, atol=1e-13)


def test_a_matrix_that_is_not_positive_definite_is_told() -> None:
    # Eigenvalues -1 and 3.
    band = np.array([[1.0, 0.0, 0.0], [1.0, 2.0, 0.0]])
    assert not solve_banded_kernel(band, np.ones(2))
    assert not solve_banded_kernel(np.array([[0.0, 0.0, 0.0]]), np.ones(1))


def test_wide_bands_with_several_right_hand_sides_are_solved_as_by_scipy() -> None:
    rng = np.random.default_rng(1)
    for size, width in ((1, 6), (3, 6), (40, 6), (40, 2)):
        band = np.zeros((size, width))
        band[:, 0] = rng.uniform(6.0, 8.0, size)
        for k in range(1, min(width, size)):
            band[k:, k] = rng.uniform(-0.6, 0.6, size - k)
        right = rng.normal(size=(size, 16))
        lower = np.zeros((min(width, size), size))
        for k in range(min(width, size)):
            lower[k, : size - k] = band[k:, k]
        expected = solveh_banded(lower, right, lower=True)
        answer = right.copy()
        assert solve_wide_band_kernel(band.copy(), answer, width)
        np.testing.assert_allclose(answer, expected, rtol=1e-12, atol=1e-13)
        solved = answer
        # Diagonals beyond those that count are not read.
        wide, answer = np.pad(band, ((0, 0), (0, 2)), constant_values=np.nan), right.copy()
        assert solve_wide_band_kernel(wide, answer, width)
        np.testing.assert_array_equal(answer, solved)
    indefinite = np.array([[1.0, 0.0], [1.0, 2.0]]) * [1, 2]
    assert not solve_wide_band_kernel(indefinite, np.ones((2, 8)), 2)
