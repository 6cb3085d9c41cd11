"""Cholesky's factors of matrices with two diagonals on either side, in place."""

import math

from kinematics.arrays import Array
from kinematics.compiled.kernel import kernel


@kernel(allocates=False)
def solve_banded_kernel(band: Array, right: Array) -> bool:
    """Solve A x = b in place by Cholesky's factors; False where A is not positive definite.

    Args:
        band: The symmetric A with two diagonals on either side, shape (N, 3): ``band[i, k]`` is the
            entry in row i, column i - k. Its factors take its place.
        right: b, and the answer x, shape (N,).
    """
    size = band.shape[0]
    for i in range(size):
        if i >= 2:
            band[i, 2] /= band[i - 2, 0]
            band[i, 1] -= band[i, 2] * band[i - 1, 1]
        if i >= 1:
            band[i, 1] /= band[i - 1, 0]
        pivot = band[i, 0] - band[i, 1] * band[i, 1] if i >= 1 else band[i, 0]
        if i >= 2:
            pivot -= band[i, 2] * band[i, 2]
        if not pivot > 0.0:
            return False
        band[i, 0] = math.sqrt(pivot)
    for i in range(size):
        value = right[i]
        if i >= 1:
            value -= band[i, 1] * right[i - 1]
        if i >= 2:
            value -= band[i, 2] * right[i - 2]
        right[i] = value / band[i, 0]
    for i in range(size - 1, -1, -1):
        value = right[i]
        if i + 1 < size:
            value -= band[i + 1, 1] * right[i + 1]
        if i + 2 < size:
            value -= band[i + 2, 2] * right[i + 2]
        right[i] = value / band[i, 0]
    return True


@kernel(allocates=False)
def solve_wide_band_kernel(band: Array, right: Array) -> bool:
    """Solve A X = B in place by Cholesky's factors; False where A is not positive definite.

    Args:
        band: The symmetric A with w - 1 diagonals on either side, shape (N, w): ``band[i, k]`` is
            the entry in row i, column i - k. Its factors take its place.
        right: B, and the answer X, shape (N, n).
    """
    size, width = band.shape
    for i in range(size):
        for k in range(min(width - 1, i), -1, -1):
            column = i - k
            value = band[i, k]
            for m in range(max(0, i - width + 1, column - width + 1), column):
                value -= band[i, i - m] * band[column, column - m]
            if k > 0:
                band[i, k] = value / band[column, 0]
                continue
            if not value > 0.0:
                return False
            band[i, 0] = math.sqrt(value)
    for i in range(size):
        for j in range(right.shape[1]):
            value = right[i, j]
            for m in range(max(0, i - width + 1), i):
                value -= band[i, i - m] * right[m, j]
            right[i, j] = value / band[i, 0]
    for i in range(size - 1, -1, -1):
        for j in range(right.shape[1]):
            value = right[i, j]
            for m in range(i + 1, min(size, i + width)):
                value -= band[m, m - i] * right[m, j]
            right[i, j] = value / band[i, 0]
    return True
