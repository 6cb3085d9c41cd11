"""Cholesky's factors of matrices with two diagonals on either side, in place."""

import math

from compiled.kernel import kernel
from compiled.simd import LANES, load, store
from kinematics.arrays import Array


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
def solve_wide_band_kernel(band: Array, right: Array, width: int) -> bool:
    """Solve A X = B in place by Cholesky's factors; False where A is not positive definite.

    Args:
        band: The symmetric A with w - 1 diagonals on either side, shape (N, >= w): ``band[i, k]``
            is the entry in row i, column i - k. Its factors take its place.
        right: B, and the answer X, its columns to whole vectors, shape (N, 8 b).
        width: w.
    """
    size = band.shape[0]
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
    for block in range(0, right.shape[1], LANES):
        for i in range(size):
            total = load(right[i], block)
            for m in range(max(0, i - width + 1), i):
                total = total - band[i, i - m] * load(right[m], block)
            store(right[i], block, total / band[i, 0])
        for i in range(size - 1, -1, -1):
            total = load(right[i], block)
            for m in range(i + 1, min(size, i + width)):
                total = total - band[m, m - i] * load(right[m], block)
            store(right[i], block, total / band[i, 0])
    return True
