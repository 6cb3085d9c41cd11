"""The quintic spline of least squares to points in its spans, at rest at both ends.

Unknown are the control points but for three at either end, which lie at the ends' positions. Their
normal equations have five diagonals on either side. Vectors hold a number of eight joints.
"""

from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from compiled.simd import LANES, fill, load, store
from kinematics.arrays import Array
from planning.timing.jerk.banded_cholesky import solve_wide_band_kernel
from planning.timing.spline.quintic_basis import (
    DEGREE,
    ORDER,
    ROW,
    TABLE,
    write_bases,
    write_values,
)

# Control points at either end that rest there: position, velocity and acceleration.
_FIXED = 3


class LeastSquares(NamedTuple):
    """Room for a fit of N spans to p points in each, N' and n' to whole vectors.

    Args:
        knots: Shape (N' + 11,).
        bases: Shape (36 N',).
        values: Shape (N' p, ROW).
        control: Control points, shape (N + 5, n').
        band: Of the normal equations, shape (N - 1, 8).
    """

    knots: Array
    bases: Array
    values: Array
    control: Array
    band: Array


@kernel
def least_squares_room(size: int, count: int, width: int) -> LeastSquares:
    """Room for a fit.

    Args:
        size: Number of spans N, at least 2.
        count: Points in each.
        width: Number of joints, to whole vectors.
    """
    whole = -(-size // LANES) * LANES
    return LeastSquares(
        np.empty(whole + 2 * DEGREE + 1),
        np.empty(whole // LANES * TABLE),
        np.zeros((whole * count, ROW)),
        np.empty((size + DEGREE, width)),
        np.empty((size + DEGREE - 2 * _FIXED, LANES)),
    )


@kernel(allocates=False)
def fit_points(
    room: LeastSquares, points: Array, shares: Array, ends: Array, spans: Array, pieces: Array
) -> None:
    """Write the pieces of the spline.

    Args:
        room: Of ``least_squares_room``.
        points: To be near to, by span, shape (N, p, n').
        shares: Places of the points in their span, in (0, 1), shape (p,).
        ends: Positions at rest, shape (2, n').
        spans: To whole vectors, shape (N',) [s].
        pieces: Filled with coefficients of ascending powers of the time in the span, (N, 6, n').
    """
    size, width = points.shape[0], points.shape[2]
    control, bases = room.control, room.bases
    unknown = size + DEGREE - 2 * _FIXED
    write_bases(spans, size, room.knots, bases)
    write_values(bases, spans, shares, room.values)
    control[:] = 0.0
    for row in range(_FIXED):
        for joint in range(width):
            control[row, joint] = ends[0, joint]
            control[size + DEGREE - 1 - row, joint] = ends[1, joint]
    _add_normal_equations(points, room.values, control, room.band)
    solve_wide_band_kernel(room.band, control[_FIXED : _FIXED + unknown], ORDER)
    for i in range(size):
        at = i // LANES * TABLE + i % LANES
        for block in range(0, width, LANES):
            for k in range(ORDER):
                value = fill(0.0)
                for j in range(ORDER):
                    weight = bases[at + (j * ORDER + k) * LANES]
                    value = value + weight * load(control[i + j], block)
                store(pieces[i, k], block, value)


@kernel(allocates=False)
def _add_normal_equations(points: Array, values: Array, control: Array, band: Array) -> None:
    """Add up the normal equations of the control points between the fixed ones.

    Args:
        points: Shape (N, p, n').
        values: Of the basis functions at the points.
        control: The fixed control points, zeros between them; the right-hand sides take their
            place, shape (N + 5, n').
        band: Filled with the matrix for ``solve_wide_band_kernel``, shape (N - 1, 8).
    """
    size, count, width = points.shape
    band[:] = 0.0
    for i in range(size):
        # Functions of free control points are in the middle; the others' parts are known.
        low, high = max(0, _FIXED - i), min(DEGREE, band.shape[0] - 1 + _FIXED - i)
        for q in range(count):
            row = values[i * count + q]
            for block in range(0, width, LANES):
                target = load(points[i, q], block)
                for j in range(low):
                    target = target - row[DEGREE - j] * load(control[i + j], block)
                for j in range(high + 1, ORDER):
                    target = target - row[DEGREE - j] * load(control[i + j], block)
                for j in range(low, high + 1):
                    right = control[i + j]
                    store(right, block, load(right, block) + row[DEGREE - j] * target)
            for j in range(low, high + 1):
                # Entries left of the matrix are written too, and not read.
                products = row[DEGREE - j] * load(row, DEGREE - j)
                diagonals = band[i + j - _FIXED]
                store(diagonals, 0, load(diagonals, 0) + products)
