"""Basis functions of clamped quintic splines, for eight spans abreast.

Knots are the breaks of the spline, the first and the last six times. In span i the six functions
that are not zero there are polynomials of the time since the span began, by de Boor's recursion

    B_j,p(t) = (t - t_j) / (t_(j+p) - t_j) B_j,p-1(t)
             + (t_(j+p+1) - t) / (t_(j+p+1) - t_(j+1)) B_(j+1),p-1(t)

on their coefficients ("A practical guide to splines", 1978). Vectors hold a number of eight spans.
"""

from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from compiled.simd import LANES, fill, load, on_stack, store
from compiled.simd_transpose import load_rows_kernel, store_rows_kernel, transpose
from kinematics.arrays import Array
from planning.timing.jerk.banded_cholesky import solve_wide_band_kernel

# Control points at either end that rest there: position, velocity and acceleration.
_FIXED = 3
#: Degree of the spline: four derivatives are continuous.
DEGREE = 5
#: Basis functions that are not zero in a span, and coefficients of each.
ORDER = DEGREE + 1
#: Numbers of a table of functions by coefficients in each of eight spans.
TABLE = ORDER * ORDER * LANES
# Numbers of eight vectors.
_SQUARE = LANES * LANES
#: Numbers in a row of ``write_values``: zeros follow the functions, so that reading on is harmless.
ROW = 2 * LANES


@kernel(allocates=False)
def write_bases(spans: Array, size: int, knots: Array, bases: Array) -> None:
    """Write the basis functions of a spline as polynomials of the time in a span.

    Args:
        spans: Shape (>= size,) [s].
        size: Number of spans N.
        knots: Room, shape (N' + 11,), with N' the number of spans to whole vectors.
        bases: Table for each eight spans a table, flat: vector 6 j + k is the k-th coefficient of
            the j-th function that is not zero there. Lanes of no span hold no numbers.
    """
    knots[:ORDER] = 0.0
    for i in range(size):
        knots[ORDER + i] = knots[DEGREE + i] + spans[i]
    for i in range(ORDER + size, knots.shape[0]):
        knots[i] = knots[DEGREE + size]
    for first in range(0, size, LANES):
        at = first // LANES * TABLE
        for entry in range(0, TABLE, LANES):
            store(bases, at + entry, 0.0)
        store(bases, at, 1.0)
        for degree in range(1, ORDER):
            _raise_degree(knots, first, degree, bases, at)


@kernel(inline="code", allocates=False)
def _raise_degree(knots: Array, first: int, degree: int, bases: Array, at: int) -> None:
    """Make functions of one degree less into those of a degree, from the last function down."""
    here = load(knots, first + DEGREE)
    fall, left = fill(0.0), fill(0.0)
    for j in range(degree, -1, -1):
        low, rise, away = first + DEGREE - degree + j, fill(0.0), fill(0.0)
        if j > 0:
            begins, ends = load(knots, low), load(knots, low + degree)
            rise, away = 1.0 / (ends - begins), here - begins
        one, before = at + j * ORDER * LANES, at + (j - 1) * ORDER * LANES
        for k in range(degree, -1, -1):
            value = fill(0.0)
            if j > 0:
                less = fill(0.0)
                if k > 0:
                    less = load(bases, before + (k - 1) * LANES)
                value = value + (less + away * load(bases, before + k * LANES)) * rise
            if j < degree:
                less = fill(0.0)
                if k > 0:
                    less = load(bases, one + (k - 1) * LANES)
                value = value + (left * load(bases, one + k * LANES) - less) * fall
            store(bases, one + k * LANES, value)
        if j > 0:
            # The part by which a function rises is the one by which the one before it falls.
            fall, left = rise, load(knots, low + degree) - here


@kernel(allocates=False)
def write_values(bases: Array, spans: Array, shares: Array, values: Array) -> None:
    """Write the values of the basis functions at points of each span.

    Args:
        bases: Table of ``write_bases``.
        spans: Spans to whole vectors, shape (N',) [s].
        shares: Places of the points in their span, in [0, 1], shape (p,).
        values: Shape (N' p, ROW): row i p + q is of point q of span i, the last function first and
            zeros after the first.
    """
    count = shares.shape[0]
    flat, rows = values.reshape(values.size), on_stack(_SQUARE)
    store(rows, ORDER * LANES, 0.0)
    store(rows, (ORDER + 1) * LANES, 0.0)
    for first in range(0, spans.shape[0], LANES):
        at, lengths = first // LANES * TABLE, load(spans, first)
        for q in range(count):
            place = shares[q] * lengths
            for j in range(ORDER):
                value = fill(0.0)
                for k in range(DEGREE, -1, -1):
                    value = value * place + load(bases, at + (j * ORDER + k) * LANES)
                store(rows, (DEGREE - j) * LANES, value)
            by_span = transpose(load_rows_kernel(rows, 0, LANES))
            store_rows_kernel(flat, (first * count + q) * ROW, count * ROW, by_span)


class LeastSquares(NamedTuple):
    """Room for a fit of N spans to p points in each, N' and n' to whole vectors.

    Args:
        knots: Shape (N' + 11,).
        bases: Shape (36 N',).
        values: Shape (N' p, ROW).
        control: Control points, shape (N + 5, n').
        band: Band of the normal equations, shape (N - 1, 8).
    """

    knots: Array
    bases: Array
    values: Array
    control: Array
    band: Array


@kernel
def least_squares_memory(size: int, count: int, width: int) -> LeastSquares:
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
        room: Room of ``least_squares_memory``.
        points: Points to be near to, by span, shape (N, p, n').
        shares: Places of the points in their span, in (0, 1), shape (p,).
        ends: Positions at rest, shape (2, n').
        spans: Spans to whole vectors, shape (N',) [s].
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
        values: Values of the basis functions at the points.
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
