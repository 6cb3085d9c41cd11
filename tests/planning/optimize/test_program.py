"""A round by IPOPT: the least time by linear programs, rows where they belong."""

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.sparse import csc_matrix, csr_matrix

from kinematics.arrays import Array
from planning.optimize.program import Limits, solve
from planning.optimize.quadratic import Quadratic
from planning.optimize.rows import Rows
from planning.optimize.spline import SplineSpace

SPACE = SplineSpace.uniform(3, 9)
SIZE = SPACE.count + 2
VELOCITY, ACCELERATION = 1.0, 4.0
NO_ROWS = Rows.below(csr_matrix((0, SIZE)), np.zeros(0))


def from_rest_to_rest(way: float, most: float = np.inf) -> Quadratic:
    """The time of one joint from 0 to ``way``, its two control points at either end fixed."""
    least, largest = np.full(SIZE, -10.0), np.full(SIZE, 10.0)
    least[:2] = largest[:2] = 0.0
    least[-4:-2] = largest[-4:-2] = way
    least[-2:], largest[-2:] = [0.05, 0.0], [50.0, most]
    g = np.zeros(SIZE)
    g[-2:] = 1.0, 20.0
    none = np.zeros(0)
    H = csc_matrix(1e-9 * np.eye(SIZE))
    return Quadratic(H, g, NO_ROWS.A, none, none, least, largest)


def guess(way: float) -> Array:
    return np.append(way * np.clip((np.arange(SPACE.count) - 1.0) / 6.0, 0.0, 1.0), [6.0, 0.1])


def least_time(way: float, hair: float, rows: Rows = NO_ROWS) -> float:
    """The least T at which a linear program has control points, by bisection."""
    D1, D2 = SPACE.differences[:2]
    fixed = [(0.0, 0.0)] * 2 + [(-10.0, 10.0)] * (SPACE.count - 4) + [(way, way)] * 2
    low, high = 0.05, 50.0
    for _ in range(50):
        T = 0.5 * (low + high)
        v, a = (1.0 - hair) * VELOCITY * T, (1.0 - hair) * ACCELERATION * T**2
        A = np.concatenate([D1, -D1, D2, -D2])
        b = np.repeat([v, v, a, a], [len(D1), len(D1), len(D2), len(D2)])
        if len(rows.upper):
            A = np.concatenate([A, rows.A.toarray()[:, :-2]])
            b = np.append(b, rows.upper - T * rows.A.toarray()[:, -2])
        found = linprog(np.zeros(SPACE.count), A_ub=A, b_ub=b, bounds=fixed).status == 0
        low, high = (low, T) if found else (T, high)
    return high


@pytest.mark.parametrize("way", [0.1, 1.0, 3.0])
@pytest.mark.parametrize("hair", [0.0, 0.05])
def test_the_least_time_is_that_of_linear_programs(way: float, hair: float) -> None:
    limits = Limits({1: np.array([VELOCITY]), 2: np.array([ACCELERATION])}, hair)
    z = solve(SPACE, limits, NO_ROWS, from_rest_to_rest(way), guess(way))
    assert z is not None
    assert z[-2] == pytest.approx(least_time(way, hair), rel=1e-4)
    assert z[-1] == pytest.approx(0.0, abs=1e-5)
    for order, limit in ((1, VELOCITY), (2, ACCELERATION)):
        rates = SPACE.differences[order - 1] @ z[:-2] / z[-2] ** order
        assert np.abs(rates).max() <= (1.0 - hair) * limit * (1.0 + 1e-5)


def test_rows_are_kept_wherever_on_the_motion_they_are() -> None:
    """More rows than one piece has room for at first, and some of no control point at all."""
    rng, way = np.random.default_rng(0), 1.0
    base = guess(way)[:-2]
    A = np.zeros((60, SIZE))
    for i in range(58):
        # All but two on the third piece.
        first = 2 if i < 40 else int(rng.integers(0, SPACE.pieces))
        A[i, first : first + 4] = rng.normal(size=4)
    A[58, -2] = -1.0
    A[59, -2:] = -1.0, -1.0
    upper = np.concatenate([A[:58, :-2] @ base + 0.02, [-1.9, -2.0]])
    rows = Rows.below(csr_matrix(A), upper)
    limits = Limits({1: np.array([VELOCITY]), 2: np.array([ACCELERATION])}, 0.0)
    z = solve(SPACE, limits, rows, from_rest_to_rest(way, 0.0), guess(way))
    assert z is not None
    assert (A @ z - upper).max() <= 1e-5
    assert z[-2] == pytest.approx(least_time(way, 0.0, rows), rel=1e-4)
    assert z[-2] > 1.05 * least_time(way, 0.0)


def test_rows_with_lower_bounds_hold_too() -> None:
    A = np.zeros((1, SIZE))
    A[0, 4] = 1.0
    limits = Limits({1: np.array([VELOCITY]), 2: np.array([ACCELERATION])}, 0.0)
    for low, high in ((0.9, np.inf), (-np.inf, 0.1), (0.3, 0.3)):
        rows = Rows(csr_matrix(A), np.array([low]), np.array([high]))
        z = solve(SPACE, limits, rows, from_rest_to_rest(1.0), guess(1.0))
        assert z is not None
        assert low - 1e-5 <= z[4] <= high + 1e-5


def test_rows_that_contradict_each_other_have_no_solution() -> None:
    A = np.zeros((2, SIZE))
    A[:, 4] = 1.0
    rows = Rows(csr_matrix(A), np.array([0.8, -np.inf]), np.array([np.inf, 0.2]))
    limits = Limits({1: np.array([VELOCITY]), 2: np.array([ACCELERATION])}, 0.0)
    assert solve(SPACE, limits, rows, from_rest_to_rest(1.0), guess(1.0)) is None


def test_the_quadratic_part_pulls_the_control_points() -> None:
    """Without haste the point nearest to where the objective is least."""
    asked = from_rest_to_rest(1.0)
    H, wanted = np.zeros((SIZE, SIZE)), np.linspace(0.4, -0.3, 5)
    H[2:7, 2:7] = np.eye(5)
    g = np.zeros(SIZE)
    g[2:7] = -wanted
    calm = Quadratic(csc_matrix(H), g, asked.A, asked.lower, asked.upper, asked.least, asked.most)
    limits = Limits({1: np.array([VELOCITY]), 2: np.array([ACCELERATION])}, 0.0)
    z = solve(SPACE, limits, NO_ROWS, calm, guess(1.0))
    assert z is not None
    np.testing.assert_allclose(z[2:7], wanted, atol=1e-5)


def test_joints_are_told_apart() -> None:
    """The slower joint sets the time, and rows of the second are not read as the first's."""
    n, way = 2, np.array([1.0, 1.0])
    size = n * SPACE.count + 2
    least, most = np.full(size, -10.0), np.full(size, 10.0)
    least[: 2 * n] = most[: 2 * n] = 0.0
    least[-2 - 2 * n : -2] = most[-2 - 2 * n : -2] = np.tile(way, 2)
    least[-2:], most[-2:] = [0.05, 0.0], [50.0, 0.0]
    g = np.zeros(size)
    g[-2] = 1.0
    A = np.zeros((1, size))
    A[0, n * 4 + 1] = 1.0
    rows = Rows(csr_matrix(A), np.array([0.1]), np.array([0.1]))
    none = np.zeros(0)
    asked = Quadratic(
        csc_matrix(1e-9 * np.eye(size)), g, csr_matrix((0, size)), none, none, least, most
    )
    start = np.append(np.repeat(guess(1.0)[:-2], n), [6.0, 0.0])
    velocity = np.array([VELOCITY, 0.25 * VELOCITY])
    limits = Limits({1: velocity, 2: np.full(n, ACCELERATION)}, 0.0)
    z = solve(SPACE, limits, rows, asked, start)
    assert z is not None
    points = z[:-2].reshape(SPACE.count, n)
    assert points[4, 1] == pytest.approx(0.1, abs=1e-5)
    rates = SPACE.differences[0] @ points / z[-2]
    assert (np.abs(rates).max(axis=0) <= velocity * (1.0 + 1e-5)).all()
    assert np.abs(rates).max(axis=0)[1] == pytest.approx(0.25 * VELOCITY, rel=1e-3)
