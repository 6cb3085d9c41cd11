"""Basis functions of clamped quintic splines, for eight spans abreast.

Knots are the breaks of the spline, the first and the last six times. In span i the six functions
that are not zero there are polynomials of the time since the span began, by de Boor's recursion

    B_j,p(t) = (t - t_j) / (t_(j+p) - t_j) B_j,p-1(t)
             + (t_(j+p+1) - t) / (t_(j+p+1) - t_(j+1)) B_(j+1),p-1(t)

on their coefficients ("A practical guide to splines", 1978). Vectors hold a number of eight spans.
"""

from compiled.kernel import kernel
from compiled.simd import LANES, fill, load, on_stack, store
from compiled.simd_transpose import load_rows_kernel, store_rows_kernel, transpose
from kinematics.arrays import Array

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
        bases: For each eight spans a table, flat: vector 6 j + k is the k-th coefficient of the
            j-th function that is not zero there. Lanes of no span hold no numbers.
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
        bases: Of ``write_bases``.
        spans: To whole vectors, shape (N',) [s].
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
