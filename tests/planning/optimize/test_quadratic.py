"""Convex quadratic problems: optimality conditions by scipy, and what counts as a solution."""

import numpy as np
import pytest
from scipy.optimize import linprog, nnls
from scipy.sparse import csc_matrix

from kinematics.arrays import Array
from planning.optimize.quadratic import Quadratic

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


def test_without_constraints_the_solution_is_that_of_the_linear_system() -> None:
    rng = np.random.default_rng(1)
    root, g = rng.normal(size=(3, 3)), rng.normal(size=3)
    H = root @ root.T + np.eye(3)
    none = np.zeros((0, 3))
    z = Quadratic(H, g, none, np.zeros(0), np.zeros(0), -WIDE, WIDE).solve()
    assert z is not None
    np.testing.assert_allclose(z, np.linalg.solve(H, -g), atol=1e-6)


def test_the_same_problem_has_the_same_bytes() -> None:
    first, again = problem(2).solve(), problem(2).solve()
    assert first is not None
    assert again is not None
    assert first.tobytes() == again.tobytes()


def test_a_value_is_half_the_square_and_the_linear_part() -> None:
    asked = Quadratic(
        np.diag([2.0, 4.0, 0.0]), np.array([1.0, 0.0, -1.0]), np.eye(3), -WIDE, WIDE, -WIDE, WIDE
    )
    assert asked.value(np.array([3.0, 1.0, 5.0])) == 0.5 * (2.0 * 9.0 + 4.0) + 3.0 - 5.0


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


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_point_that_is_not_finite_is_no_solution(value: float) -> None:
    asked = Quadratic(np.eye(3), np.zeros(3), np.eye(3), -WIDE, WIDE, -WIDE, WIDE)
    assert asked.satisfies(np.ones(3))
    assert not asked.satisfies(np.array([0.0, value, 0.0]))
