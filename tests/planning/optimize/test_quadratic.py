"""Convex quadratic problems and rounds by IPOPT: optimality by scipy."""

import numpy as np
import pytest
from scipy.optimize import linprog, nnls
from scipy.sparse import csc_matrix, csr_matrix

from kinematics.arrays import Array
from planning.optimize.linearization import Rows
from planning.optimize.program import solve
from planning.optimize.quadratic import Quadratic
from planning.optimize.spline import SplineSpace

WIDE = np.full(3, np.inf)


def problem(seed: int) -> Quadratic:
    """A random problem with rows on one side, on both, and of equality, and bounds."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(2, 9)), int(rng.integers(1, 9))
    root = rng.normal(size=(n, n))
    A, middle = rng.normal(size=(m, n)), rng.normal(size=m)
    lower = np.where(rng.random(m) < 0.3, -np.inf, middle - rng.uniform(0.0, 1.0, m))
    upper = np.where(rng.random(m) < 0.3, np.inf, middle + rng.uniform(0.0, 1.0, m))
    if rng.random() < 0.4:
        lower[0] = upper[0] = middle[0]
    H = csc_matrix(root @ root.T + 1e-3 * np.eye(n))
    g = 3.0 * rng.normal(size=n)
    return Quadratic(H, g, csc_matrix(A), lower, upper, np.full(n, -2.0), np.full(n, 2.0))


def halves(asked: Quadratic) -> tuple[Array, Array]:
    """All constraints as rows A z <= b."""
    n, A = len(asked.g), asked.A.toarray()
    rows = np.concatenate([A, -A, np.eye(n), -np.eye(n)])
    bounds = np.concatenate([asked.upper, -asked.lower, asked.most, -asked.least])
    finite = np.isfinite(bounds)
    return rows[finite], bounds[finite]


def test_solutions_meet_the_optimality_conditions_and_none_is_missed() -> None:
    solved = impossible = 0
    for seed in range(120):
        asked = problem(seed)
        A, b = halves(asked)
        z = asked.solve()
        feasible = linprog(np.zeros(len(asked.g)), A_ub=A, b_ub=b, bounds=(None, None)).status == 0
        assert (z is not None) == feasible
        if z is None:
            impossible += 1
            continue
        solved += 1
        assert (A @ z - b).max() < 1e-5
        gradient = asked.H @ z + asked.g
        active = A @ z - b > -1e-4
        # The downhill direction is a combination of the active rows with positive weights.
        rest = nnls(A[active].T, -gradient)[1] if active.any() else np.linalg.norm(gradient)
        assert rest < 1e-4 * (1.0 + np.linalg.norm(gradient))
    assert solved > 60
    assert impossible > 5


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("size", [1.0, 1e4])
def test_a_point_keeps_rows_and_bounds_to_a_millionth_of_what_they_are(
    sign: float, size: float
) -> None:
    limit = np.full(3, size)
    rows = Quadratic(np.eye(3), np.zeros(3), np.eye(3), -limit, limit, -WIDE, WIDE)
    bounds = Quadratic(np.eye(3), np.zeros(3), np.eye(3), -WIDE, WIDE, -limit, limit)
    for asked in (rows, bounds):
        for excess, kept in ((0.0, True), (0.5e-6 * size, True), (3e-6 * size, False)):
            z = np.array([0.0, sign * (size + excess), 0.0])
            assert asked.satisfies(z) is kept


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
    share = 1.0 - hair
    limits = {1: np.array([share * VELOCITY]), 2: np.array([share * ACCELERATION])}
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
    limits = {1: np.array([VELOCITY]), 2: np.array([ACCELERATION])}
    z = solve(SPACE, limits, rows, from_rest_to_rest(way, 0.0), guess(way))
    assert z is not None
    assert (A @ z - upper).max() <= 1e-5
    assert z[-2] == pytest.approx(least_time(way, 0.0, rows), rel=1e-4)
    assert z[-2] > 1.05 * least_time(way, 0.0)


def test_rows_that_contradict_each_other_have_no_solution() -> None:
    A = np.zeros((2, SIZE))
    A[:, 4] = 1.0
    rows = Rows(csr_matrix(A), np.array([0.8, -np.inf]), np.array([np.inf, 0.2]))
    limits = {1: np.array([VELOCITY]), 2: np.array([ACCELERATION])}
    assert solve(SPACE, limits, rows, from_rest_to_rest(1.0), guess(1.0)) is None
