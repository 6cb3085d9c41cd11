"""The nearest point to a given one under linear inequalities: the step of the nonlinear programs.

    minimise |x - d|^2 / 2    subject to    a_i . x <= b_i

by a dual active-set method: from the unconstrained minimum the most violated inequality is taken in
turn, and those that no longer press are let go. It ends with the exact minimum or with the proof
that there is none. Source: "A numerically stable dual method for solving strictly convex quadratic
programs", Mathematical Programming, 1983.
"""

import math

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices


@kernel
def least_distance(A: Array, b: Array, count: int, d: Array, x: Array) -> bool:
    """Write the nearest x (n,) to d (n,) with A x <= b over the first ``count`` rows of A (k, n).

    Returns:
        False where there is none; x is then the last point looked at.
    """
    n = d.shape[0]
    for j in range(n):
        x[j] = d[j]
    active = np.empty(n, dtype=np.int64)
    duals, r, z = np.zeros(n + 1), np.zeros(n), np.empty(n)
    gram = np.empty((n, n))
    size = 0
    # More changes of the active set are rounding that goes round in circles.
    for _ in range(20 * (count + 1)):
        p, worst = _most_violated_row(A, b, count, x)
        if p < 0:
            return True
        dual = 0.0
        while True:
            _explain(A, active, size, p, gram, r)
            left, square = _residual_normal(A, active, size, p, r, z)
            partial, leaving = _longest_dual_step(duals, r, size)
            whole = math.inf
            # Below 1e-16 of a row's square, the other rows explain all of it.
            if left > 1e-16 * square and size < n:
                whole = worst / left
            step = min(partial, whole)
            if math.isinf(step):
                return False
            dual += step
            for i in range(size):
                duals[i] -= step * r[i]
            if whole < math.inf:
                for j in range(n):
                    x[j] -= step * z[j]
                worst -= step * left
            if step == whole:
                active[size], duals[size] = p, dual
                size += 1
                break
            size -= 1
            for i in range(leaving, size):
                active[i], duals[i] = active[i + 1], duals[i + 1]
    return False


@kernel(allocates=False)
def _most_violated_row(A: Array, b: Array, count: int, x: Array) -> tuple[int, float]:
    """The row that x violates most and by how much; -1 where it violates none."""
    # Inequalities are kept to 1e-11 (their rows have the length of about a metre, or 1).
    p, worst = -1, 1e-11
    for i in range(count):
        excess = -b[i]
        for j in range(x.shape[0]):
            excess += A[i, j] * x[j]
        if excess > worst:
            p, worst = i, excess
    return p, worst


@kernel(allocates=False)
def _residual_normal(
    A: Array, active: Indices, size: int, p: int, r: Array, z: Array
) -> tuple[float, float]:
    """Write a_p - sum_i r_i a_i over the active rows i; its square, and that of a_p."""
    left, square = 0.0, 0.0
    for j in range(A.shape[1]):
        z[j] = A[p, j]
        square += A[p, j] * A[p, j]
        for i in range(size):
            z[j] -= r[i] * A[active[i], j]
        left += z[j] * z[j]
    return left, square


@kernel(allocates=False)
def _longest_dual_step(duals: Array, r: Array, size: int) -> tuple[float, int]:
    """The step at which the first multiplier becomes 0, and which; inf and -1 where none does."""
    step, leaving = math.inf, -1
    for i in range(size):
        if r[i] > 0.0 and duals[i] < step * r[i]:
            step, leaving = duals[i] / r[i], i
    return step, leaving


@kernel
def _explain(A: Array, active: Indices, size: int, p: int, gram: Array, r: Array) -> None:
    """Least-squares coefficients r of row p in the active rows, by their Gram matrix's factors."""
    n = A.shape[1]
    for i in range(size):
        for k in range(i + 1):
            total = 0.0
            for j in range(n):
                total += A[active[i], j] * A[active[k], j]
            for l in range(k):  # noqa: E741
                total -= gram[i, l] * gram[k, l]
            gram[i, k] = math.sqrt(max(total, 1e-300)) if i == k else total / gram[k, k]
        total = 0.0
        for j in range(n):
            total += A[active[i], j] * A[p, j]
        for k in range(i):
            total -= gram[i, k] * r[k]
        r[i] = total / gram[i, i]
    for i in range(size - 1, -1, -1):
        total = r[i]
        for k in range(i + 1, size):
            total -= gram[k, i] * r[k]
        r[i] = total / gram[i, i]
