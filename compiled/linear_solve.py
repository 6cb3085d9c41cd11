"""Small dense systems of linear equations inside kernels: Cholesky and LU, in place.

Source: "Matrix computations", 4th edition, 2013, algorithms 4.2.1 (Cholesky) and 3.4.1 (LU with
partial pivoting).
"""

import math

import numpy as np
from numpy.typing import NDArray

from compiled.arrays import Array, Indices
from compiled.kernel import kernel
from compiled.simd import on_stack

Complex = NDArray[np.complex128]

#: A pivot smaller than this share of its diagonal entry is rounding error.
_PIVOT_RATIO = 1e-14
#: Stands for a pivot that rounding took to 0 or below, so that no root fails.
_LEAST_PIVOT = 1e-300
#: The largest system that `solve_kernel` has room for.
_MAX_ROWS = 64


@kernel(allocates=False)
def cholesky_solve_kernel(A: Array, x: Array, n: int) -> int:
    """Solve A x = b in place for the leading n rows of a positive definite A.

    Args:
        A: Symmetric, of which the lower half is read; overwritten by its factor, with the
            reciprocals of the factor's diagonal. Shape (n, n) or larger.
        x: The right side b, overwritten by the solution, shape (n,) or longer.
        n: How many rows count.

    Returns:
        -1, or the first row whose pivot is not positive: A is not positive definite then.
    """
    weak = -1
    for i in range(n):
        for j in range(i):
            total = A[i, j]
            for k in range(j):
                total -= A[i, k] * A[j, k]
            # A division costs as much as ten multiplications: hence the reciprocals.
            A[i, j] = total * A[j, j]
        total, diagonal = A[i, i], A[i, i]
        for k in range(i):
            total -= A[i, k] * A[i, k]
        if weak < 0 and not total > _PIVOT_RATIO * diagonal:
            weak = i
        A[i, i] = 1.0 / math.sqrt(max(total, _LEAST_PIVOT))
    for i in range(n):
        total = x[i]
        for k in range(i):
            total -= A[i, k] * x[k]
        x[i] = total * A[i, i]
    for i in range(n - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, n):
            total -= A[k, i] * x[k]
        x[i] = total * A[i, i]
    return weak


@kernel(allocates=False)
def lu_factor_kernel(A: Array | Complex, pivots: Indices, least: float) -> bool:
    """Replace A (n, n) by its LU factors with row exchanges.

    Args:
        A: Real or complex; overwritten, L below the diagonal (its own is 1), U on it and above.
        pivots: The row that each row was exchanged with, written, shape (n,).
        least: A pivot of no larger modulus makes the matrix singular.

    Returns:
        Whether the matrix is regular; the factors are incomplete where it is not.
    """
    n = A.shape[0]
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[best, k]):
                best = i
        pivots[k] = best
        if not abs(A[best, k]) > least:
            return False
        if best != k:
            for j in range(n):
                A[k, j], A[best, j] = A[best, j], A[k, j]
        for i in range(k + 1, n):
            if A[i, k] != 0.0:
                A[i, k] /= A[k, k]
                for j in range(k + 1, n):
                    A[i, j] -= A[i, k] * A[k, j]
    return True


@kernel(allocates=False)
def lu_solve_kernel(LU: Array | Complex, pivots: Indices, x: Array | Complex) -> None:
    """Solve A x = b in place for x (n,), which holds b, with what ``lu_factor_kernel`` wrote."""
    n = x.shape[0]
    for k in range(n):
        if pivots[k] != k:
            x[k], x[pivots[k]] = x[pivots[k]], x[k]
    for i in range(n):
        for k in range(i):
            x[i] -= LU[i, k] * x[k]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= LU[i, k] * x[k]
        x[i] /= LU[i, i]


@kernel(allocates=False)
def solve_kernel(A: Array, x: Array, least: float) -> bool:
    """Solve A x = b in place for A (n, n), which is overwritten, n at most 64; x (n,) holds b.

    False where some pivot is ``least`` or smaller: the matrix is singular, and x means nothing.
    """
    pivots = on_stack(_MAX_ROWS).view(np.int64)[: x.shape[0]]
    if not lu_factor_kernel(A, pivots, least):
        return False
    lu_solve_kernel(A, pivots, x)
    return True
