"""Small dense solvers beside numpy, for well and badly conditioned systems."""

import numpy as np
import pytest

from compiled.linear_solve import (
    cholesky_solve_kernel,
    lu_factor_kernel,
    lu_solve_kernel,
    solve_kernel,
)
from kinematics.arrays import Array


def positive_definite(rng: np.random.Generator, n: int, condition: float) -> Array:
    """A symmetric matrix of a condition number."""
    Q, _ = np.linalg.qr(rng.normal(size=(n, n)))
    return np.asarray((Q * np.geomspace(1.0, 1.0 / condition, n)) @ Q.T)


@pytest.mark.parametrize("condition", [1.0, 1e3, 1e9])
def test_cholesky_equals_numpy(condition: float) -> None:
    rng = np.random.default_rng(0)
    for n in range(1, 12):
        A, b = positive_definite(rng, n, condition), rng.normal(size=n)
        # Room beyond the rows that count stays as it is.
        room, x = np.full((n + 2, n + 2), 7.0), np.full(n + 2, 7.0)
        room[:n, :n], x[:n] = A, b
        room[:n, :n][np.triu_indices(n, 1)] = np.nan  # only the lower half is read
        assert cholesky_solve_kernel(room, x, n) == -1
        residual = np.abs(A @ x[:n] - b).max()
        assert residual <= 1e-13 * n * (np.abs(A).max() * np.abs(x[:n]).max() + np.abs(b).max())
        assert (x[n:] == 7.0).all()
        assert (room[n:] == 7.0).all()
        assert (room[:, n:] == 7.0).all()


def test_cholesky_names_the_first_row_that_is_not_positive() -> None:
    rng = np.random.default_rng(1)
    A = positive_definite(rng, 5, 10.0)
    A[3, 3] = A[3, :3] @ np.linalg.solve(A[:3, :3], A[:3, 3])
    assert cholesky_solve_kernel(A.copy(), np.ones(5), 5) == 3
    A[1, 1] = -1.0
    assert cholesky_solve_kernel(A.copy(), np.ones(5), 5) == 1
    A[0, 0] = np.nan
    assert cholesky_solve_kernel(A.copy(), np.ones(5), 5) == 0
    assert cholesky_solve_kernel(np.zeros((2, 2)), np.ones(2), 2) == 0


@pytest.mark.parametrize("n", [1, 2, 3, 7, 20])
def test_lu_equals_numpy_for_real_and_complex_matrices(n: int) -> None:
    rng = np.random.default_rng(n)
    real, pivots = rng.normal(size=(n, n)), np.zeros(n, dtype=np.int64)
    for A in (real, real + 1j * rng.normal(size=(n, n))):
        b = rng.normal(size=n).astype(A.dtype)
        LU, x = A.copy(), b.copy()
        assert lu_factor_kernel(LU, pivots, 0.0)
        lu_solve_kernel(LU, pivots, x)
        y = b.copy()
        assert solve_kernel(A.copy(), y, 0.0)
        np.testing.assert_array_equal(y, x)
        np.testing.assert_allclose(x, np.linalg.solve(A, b), rtol=1e-9, atol=1e-12)
        # The factors are of A with its rows exchanged.
        exchanged = A.copy()
        for k in range(n):
            exchanged[[k, pivots[k]]] = exchanged[[pivots[k], k]]
        L, U = np.tril(LU, -1) + np.eye(n), np.triu(LU)
        np.testing.assert_allclose(L @ U, exchanged, atol=1e-13 * n)
        assert np.abs(L).max() <= 1.0 + 1e-15 or np.iscomplexobj(A)


def test_elimination_exchanges_rows_where_a_pivot_is_zero() -> None:
    A, x = np.array([[0.0, 2.0], [4.0, 0.0]]), np.array([2.0, 8.0])
    assert solve_kernel(A, x, 0.0)
    assert x.tolist() == [2.0, 1.0]


@pytest.mark.parametrize("least", [0.0, 1e-14])
def test_a_singular_matrix_is_refused(least: float) -> None:
    assert not solve_kernel(np.zeros((3, 3)), np.ones(3), least)
    assert not solve_kernel(np.full((2, 2), np.nan), np.ones(2), least)
    nearly = np.diag([1.0, 1e-15, 1.0])
    assert solve_kernel(nearly.copy(), np.ones(3), 1e-14) is False
    assert solve_kernel(nearly.copy(), np.ones(3), 0.0) is True


def test_a_pivot_of_exactly_the_least_is_refused() -> None:
    for least in (0.0, 0.5):
        for pivot, regular in ((least, False), (-least, False), (np.nextafter(least, 1.0), True)):
            assert solve_kernel(np.diag([2.0, pivot]), np.ones(2), least) is regular


def test_a_refused_system_leaves_its_right_side_as_it_is() -> None:
    x = np.array([1.0, 2.0, 3.0])
    assert not solve_kernel(np.ones((3, 3)), x, 1e-12)
    assert x.tolist() == [1.0, 2.0, 3.0]


def test_a_complex_singular_matrix_is_refused_by_the_modulus_of_its_pivots() -> None:
    pivots = np.zeros(2, dtype=np.int64)
    assert not lu_factor_kernel(np.diag([1.0 + 1.0j, 1e-9j]), pivots, 1e-8)
    assert lu_factor_kernel(np.diag([1.0 + 1.0j, 1e-7j]), pivots, 1e-8)


@pytest.mark.parametrize("share", [0.1, 10.0])
def test_a_pivot_that_is_rounding_of_its_diagonal_is_not_positive(share: float) -> None:
    # The second pivot is this share of what rounding of its diagonal entry makes.
    A = np.array([[1.0, 1.0], [1.0, 1.0 + share * 1e-14]])
    assert cholesky_solve_kernel(A, np.ones(2), 2) == (1 if share < 1.0 else -1)
