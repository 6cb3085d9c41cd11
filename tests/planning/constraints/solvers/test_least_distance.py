"""Steps are the nearest points to their wishes: optimality by scipy's programs."""

import numpy as np
from scipy.optimize import linprog, nnls

from planning.constraints.solvers.least_distance import least_distance


def test_against_linear_programs_and_optimality_conditions() -> None:
    rng = np.random.default_rng(0)
    solved = impossible = 0
    for case in range(300):
        n, m = int(rng.integers(1, 9)), int(rng.integers(1, 20))
        A, b = rng.normal(size=(m, n)), rng.normal(size=m) + 0.7 * (case % 3)
        if case % 5 == 0 and m > 2:
            # An equality as two inequalities.
            A[1], b[1] = -A[0], -b[0]
        d, x = 2.0 * rng.normal(size=n), np.empty(n)
        found = least_distance(A, b, m, d, x)
        bounds = [(None, None)] * n
        feasible = linprog(np.zeros(n), A_ub=A, b_ub=b, bounds=bounds).status == 0
        assert found == feasible
        if not found:
            impossible += 1
            continue
        solved += 1
        assert (A @ x - b).max() < 1e-9 * (1.0 + np.abs(x).max())
        active = A @ x - b > -1e-8
        # d - x is a combination of the active rows with positive weights.
        rest = nnls(A[active].T, d - x)[1] if active.any() else np.linalg.norm(d - x)
        assert rest < 1e-6 * (1.0 + np.linalg.norm(d - x))
    assert min(solved, impossible) > 50


def test_rows_beyond_the_count_do_not_bind() -> None:
    A, b, x = np.array([[1.0], [1.0]]), np.array([2.0, 0.0]), np.empty(1)
    assert least_distance(A, b, 1, np.array([3.0]), x)
    assert x[0] == 2.0
