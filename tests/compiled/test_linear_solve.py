"""Small solvers, vectors, angles and random numbers beside numpy and exact arithmetic."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compiled.kernel import kernel
from compiled.linear_solve import (
    cholesky_solve_kernel,
    lu_factor_kernel,
    lu_solve_kernel,
    solve_kernel,
)
from compiled.random import uniform_kernel
from compiled.simd import on_stack
from compiled.sincos import TURNS, few_turns_kernel, turn_at_kernel, turns_kernel
from compiled.vec3 import Vector, add, cross, dot, scale, subtract
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


def test_a_complex_singular_matrix_is_refused_by_the_modulus_of_its_pivots() -> None:
    pivots = np.zeros(2, dtype=np.int64)
    assert not lu_factor_kernel(np.diag([1.0 + 1.0j, 1e-9j]), pivots, 1e-8)
    assert lu_factor_kernel(np.diag([1.0 + 1.0j, 1e-7j]), pivots, 1e-8)


@pytest.mark.parametrize("share", [0.1, 10.0])
def test_a_pivot_that_is_rounding_of_its_diagonal_is_not_positive(share: float) -> None:
    # The second pivot is this share of what rounding of its diagonal entry makes.
    A = np.array([[1.0, 1.0], [1.0, 1.0 + share * 1e-14]])
    assert cholesky_solve_kernel(A, np.ones(2), 2) == (1 if share < 1.0 else -1)


_numbers = st.floats(-1e6, 1e6, allow_subnormal=False)
_vectors = st.tuples(_numbers, _numbers, _numbers)


@settings(deadline=None)  # the first example compiles
@given(_vectors, _vectors, _numbers)
def test_vectors_are_those_of_numpy(a: Vector, b: Vector, s: float) -> None:
    x, y = np.array(a), np.array(b)
    assert add(a, b) == tuple(x + y)
    assert subtract(a, b) == tuple(x - y)
    assert scale(s, a) == tuple(s * x)
    assert cross(a, b) == tuple(np.cross(x, y))


@settings(deadline=None)  # the first example compiles
@given(_vectors, _vectors)
def test_a_scalar_product_is_right_to_its_rounding(a: Vector, b: Vector) -> None:
    exact = sum(Fraction(x) * Fraction(y) for x, y in zip(a, b, strict=True))
    terms = sum(abs(x * y) for x, y in zip(a, b, strict=True))
    assert abs(dot(a, b) - float(exact)) <= 4 * np.finfo(float).eps * terms + 1e-300


#: Up to here the arithmetic is the module's own; beyond it is that of the library.
OWN = 1e6


@kernel
def turn_each_kernel(q: Array, cosines: Array, sines: Array) -> bool:
    """Cosine and sine of each angle by what a chain's kernels call."""
    turns = on_stack(TURNS)
    few = few_turns_kernel(q, turns)
    for j in range(q.shape[0]):
        cosines[j], sines[j] = turn_at_kernel(q, j, few, turns)
    return few


def together(q: Array) -> tuple[Array, Array]:
    """Cosines and sines of an array at once."""
    c, s = np.full((2, len(q)), np.nan)
    turns_kernel(q, c, s)
    return c, s


def each(q: Array) -> tuple[bool, Array, Array]:
    """Whether the angles went into one vector; their cosines and sines, one by one."""
    c, s = np.full((2, len(q)), np.nan)
    return turn_each_kernel(q, c, s), c, s


def hard_angles() -> Array:
    """Angles at, and within rounding of, multiples of 45 degrees; tiny and large ones."""
    multiples = np.arange(-4000, 4001) * (np.pi / 4)
    beside = [np.nextafter(multiples, sign * np.inf) for sign in (-1.0, 1.0)]
    far = np.random.default_rng(0).uniform(-OWN, OWN, 4000)
    tiny = np.geomspace(1e-320, 1.0, 400)
    return np.concatenate([multiples, *beside, far, tiny, -tiny, [0.0, -0.0]])


def test_the_error_is_a_rounding_for_all_angles_in_range() -> None:
    q = hard_angles()
    c, s = together(q)
    exact = q.astype(np.longdouble)
    assert float(np.abs(c - np.cos(exact)).max()) < 2.3e-16
    assert float(np.abs(s - np.sin(exact)).max()) < 2.3e-16


def test_small_sines_keep_all_their_digits() -> None:
    q = np.geomspace(1e-300, 0.7, 500)
    _, s = together(q)
    exact = np.sin(q.astype(np.longdouble))
    assert float(np.abs((s - exact) / exact).max()) < 2.3e-16


@pytest.mark.parametrize("size", [OWN, 1.0000001 * OWN, 1e9, 1e15, 1e300])
def test_large_angles_are_those_of_the_library(size: float) -> None:
    q = size * np.array([1.0, -1.0, 1.5, -3.0, 7.7, 1.0, 2.0, -2.0, 1.25, 9.0, -1.0])
    c, s = together(q)
    np.testing.assert_allclose(c, np.cos(q), rtol=0.0, atol=3e-16)
    np.testing.assert_allclose(s, np.sin(q), rtol=0.0, atol=3e-16)


@pytest.mark.parametrize("place", range(0, 20, 3))
def test_one_large_angle_leaves_its_neighbours_as_they_are(place: int) -> None:
    q = np.random.default_rng(2).uniform(-4.0, 4.0, 20)
    alone = together(q)
    q[place] = 1e12
    c, s = together(q)
    others = np.arange(20) != place
    np.testing.assert_array_equal(c[others], alone[0][others])
    np.testing.assert_array_equal(s[others], alone[1][others])
    assert (c[place], s[place]) == pytest.approx((np.cos(1e12), np.sin(1e12)), abs=3e-16)


@pytest.mark.parametrize(
    "q",
    [
        np.linspace(-3.0, 3.0, 9),
        np.linspace(-3.0, 3.0, 14)[::2],
        np.linspace(-3.0, 3.0, 7)[::-1],
        np.array([0.5, OWN, 0.25]),
        np.array([0.5, -1e12]),
    ],
    ids=["nine", "apart", "backwards", "at the bound", "large"],
)
def test_other_angles_are_answered_one_by_one(q: Array) -> None:
    few, c, s = each(q)
    assert not few
    np.testing.assert_allclose(c, np.cos(q), rtol=0.0, atol=3e-16)
    np.testing.assert_allclose(s, np.sin(q), rtol=0.0, atol=3e-16)


def test_what_is_no_number_stays_none() -> None:
    q = np.array([0.3, np.nan, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, np.nan])
    for c, s in (together(q), each(q)[1:]):
        assert np.isnan(c).tolist() == np.isnan(s).tolist() == np.isnan(q).tolist()


MASK = 2**64 - 1


def splitmix64(state: int) -> tuple[int, int]:
    """The published recurrence: the next state and the output."""
    state = (state + 0x9E3779B97F4A7C15) & MASK
    x = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    x = ((x ^ (x >> 27)) * 0x94D049BB133111EB) & MASK
    return state, x ^ (x >> 31)


@pytest.mark.parametrize("seed", [0, 1, 1234567, MASK])
def test_numbers_are_those_of_the_definition(seed: int) -> None:
    state, expected = np.array([seed], dtype=np.uint64), seed
    for _ in range(100):
        expected, x = splitmix64(expected)
        assert uniform_kernel(state) == (x >> 11) / 2**53
    assert int(state[0]) == expected


def test_the_published_first_outputs_of_a_seed() -> None:
    # Of the reference implementation in C for the seed 1234567.
    outputs, state = [], 1234567
    for _ in range(3):
        state, x = splitmix64(state)
        outputs.append(x)
    assert outputs == [6457827717110365317, 3203168211198807973, 9817491932198370423]
