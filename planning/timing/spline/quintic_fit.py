"""A quintic spline of time near a motion, in few pieces, with spans as long as limits need.

The spline is fitted by least squares to points of the motion, the same points of the path all the
time; its ends are at rest. Where its velocity, acceleration or jerk exceeds a limit the span is
made longer, elsewhere shorter, until the limits are used everywhere alike. A spline rounds corners
by some milliradians more than the motion: whether it is free is for the proof to say.

Basis functions of clamped quintic splines.

Knots are the breaks of the spline, the first and the last six times. In span i the six functions
that are not zero there are polynomials of the time since the span began, by de Boor's recursion

    B_j,p(t) = (t - t_j) / (t_(j+p) - t_j) B_j,p-1(t)
             + (t_(j+p+1) - t) / (t_(j+p+1) - t_(j+1)) B_(j+1),p-1(t)

on their coefficients ("A practical guide to splines", 1978).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from compiled.kernel import directly, kernel
from compiled.simd import LANES, Lanes, fill, lane, load, store
from kinematics.arrays import Array
from kinematics.trajectory.polynomial import sample_kernel
from planning.timing.jerk.interior_point import solve_banded_kernel
from planning.timing.jerk.jerk_limited import Pieces
from planning.timing.spline.span_loads import (
    SpanLoads,
    no_loads,
    span_memory,
    widen_for_loads_kernel,
)
from planning.timing.time_scaling import ScaledTime, fit_kernel, scaled_motion

# Control points at either end that rest there: position, velocity and acceleration.
_FIXED = 3
#: Degree of the spline: four derivatives are continuous.
DEGREE = 5
#: Basis functions that are not zero in a span, and coefficients of each.
ORDER = DEGREE + 1
#: Numbers in a row of ``write_values``: zeros follow the functions, so that reading on is harmless.
ROW = 2 * LANES


@kernel(allocates=False)
def write_bases(spans: Array, knots: Array, bases: Array) -> None:
    """Write the basis functions of a spline as polynomials of the time in a span.

    Args:
        spans: Shape (N,) [s].
        knots: Buffer of the knots, shape (N + 11,).
        bases: Filled at (i, j, k) with the k-th coefficient of the j-th function that is not zero
            in span i, shape (N, 6, 6).
    """
    size = spans.shape[0]
    knots[:ORDER] = 0.0
    for i in range(size):
        knots[ORDER + i] = knots[DEGREE + i] + spans[i]
    knots[ORDER + size :] = knots[DEGREE + size]
    bases[:] = 0.0
    for i in range(size):
        own, here = bases[i], knots[DEGREE + i]
        own[0, 0] = 1.0
        for degree in range(1, ORDER):
            # The last function first: each takes its fall, and gives the next one its rise.
            for j in range(degree - 1, -1, -1):
                low, high = knots[ORDER + i + j - degree], knots[ORDER + i + j]
                rise = 1.0 / (high - low)
                for k in range(degree, -1, -1):
                    less = own[j, k - 1] if k > 0 else 0.0
                    own[j + 1, k] += rise * ((here - low) * own[j, k] + less)
                    own[j, k] = rise * ((high - here) * own[j, k] - less)


@kernel(allocates=False)
def write_values(bases: Array, spans: Array, shares: Array, values: Array) -> None:
    """Write the values of the basis functions at points of each span.

    Args:
        bases: Table of ``write_bases``.
        spans: Shape (N,) [s].
        shares: Places of the points in their span, in [0, 1], shape (p,).
        values: Shape (N p, ROW): row i p + q is of point q of span i, the last function first; what
            follows the first function is left as it is.
    """
    count = shares.shape[0]
    for i in range(spans.shape[0]):
        for q in range(count):
            place = shares[q] * spans[i]
            for j in range(ORDER):
                value = 0.0
                for k in range(DEGREE, -1, -1):
                    value = value * place + bases[i, j, k]
                values[i * count + q, DEGREE - j] = value


class LeastSquares(NamedTuple):
    """Room for a fit of N spans to p points in each, n' to whole vectors.

    Args:
        knots: Shape (N + 11,).
        bases: Shape (N, 6, 6).
        values: Shape (N p, ROW).
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
    return LeastSquares(
        np.empty(size + 2 * DEGREE + 1),
        np.empty((size, ORDER, ORDER)),
        np.zeros((size * count, ROW)),
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
        spans: Shape (N,) [s].
        pieces: Filled with coefficients of ascending powers of the time in the span, (N, 6, n').
    """
    size, width = points.shape[0], points.shape[2]
    control, bases = room.control, room.bases
    unknown = size + DEGREE - 2 * _FIXED
    write_bases(spans, room.knots, bases)
    write_values(bases, spans, shares, room.values)
    control[:] = 0.0
    for row in range(_FIXED):
        for joint in range(width):
            control[row, joint] = ends[0, joint]
            control[size + DEGREE - 1 - row, joint] = ends[1, joint]
    _add_normal_equations(points, room.values, control, room.band)
    solve_banded_kernel(room.band, control[_FIXED : _FIXED + unknown], ORDER)
    for i in range(size):
        for block in range(0, width, LANES):
            for k in range(ORDER):
                value = fill(0.0)
                for j in range(ORDER):
                    value = value + bases[i, j, k] * load(control[i + j], block)
                store(pieces[i, k], block, value)


@kernel(allocates=False)
def _add_normal_equations(points: Array, values: Array, control: Array, band: Array) -> None:
    """Add up the normal equations of the control points between the fixed ones.

    Args:
        points: Shape (N, p, n').
        values: Values of the basis functions at the points.
        control: The fixed control points, zeros between them; the right-hand sides take their
            place, shape (N + 5, n').
        band: Filled with the matrix for ``solve_banded_kernel``, shape (N - 1, 8).
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


#: Spans for each second of a motion that are tried in turn [1/s]: 26 and 39 pieces in 1.6 s. With
#: more it keeps nearer to the path.
SPAN_RATES = (16.0, 24.0)
#: Spans, at least.
MIN_SPANS = 6
# Points of the motion in each span that the spline is fitted to.
_POINTS = 6
# Places in each span at which limits are checked while its length is sought.
_PLACES = 9


def even_parts(duration: float, legs: int | None, rate: float) -> Array:
    """Ends of even parts of a motion's time, one for each span of its spline, shape (N + 1,) [s].

    Args:
        duration: Duration of the motion [s].
        legs: Number of the straight legs of its path, of which each needs a few; None for as many
            as the rate says.
        rate: Spans for each second of the motion [1/s].
    """
    count = max(MIN_SPANS, math.ceil(rate * duration))
    if legs is not None:
        # Spans, at most, for each leg of the path: slow motions need no more than fast ones.
        count = min(count, max(MIN_SPANS, 12 * legs))
    return np.asarray(np.arange(count + 1) * (duration / count))


def fit_pieces(
    motion: Pieces,
    joint_names: Sequence[str],
    limits: Array,
    parts: Array,
    loads: SpanLoads | None = None,
) -> ScaledTime:
    """The quintic spline near a motion from rest to rest, as fast as its exact peaks allow.

    Args:
        motion: The motion; nothing of it is checked.
        joint_names: n names.
        limits: Limits of velocity (inf where there is none), acceleration and jerk, positive, shape
            (3, n).
        parts: Ends of the parts of the motion that the N spans are fitted to, shape (N + 1,) [s].
        loads: Limits that spans are made longer for. They are nearly kept: the motion is as fast as
            the limits of its joints allow.

    Returns:
        The spline, and the factor by which its time was scaled at last.

    Raises:
        InvalidOption: No limit bounds the motion.
    """
    n, count = motion.coefficients.shape[1], len(parts) - 1
    breaks, coefficients = parts.copy(), np.empty((count, n, DEGREE + 1))
    factor = directly(fit_motion_kernel, *motion, limits, loads or no_loads(), breaks, coefficients)
    scaled = scaled_motion(joint_names, breaks, coefficients, factor)
    return ScaledTime(scaled.trajectory, factor, "quintic_spline")


@kernel
def fit_motion_kernel(
    given: Array,
    pieces: Array,
    limits: Array,
    loads: SpanLoads,
    breaks: Array,
    coefficients: Array,
) -> float:
    """Write breaks and coefficients of the spline near a motion; the factor of ``fit_kernel``.

    Args:
        given: Breaks of the motion, shape (m + 1,) [s].
        pieces: Coefficients, shape (m, n, k).
        limits: Limits of velocity, acceleration and jerk, shape (3, n).
        loads: Limits of torques and of the tool's speed.
        breaks: Ends of the parts of the motion that the spans are fitted to, then those of the
            spans, shape (N + 1,) [s].
        coefficients: Filled, shape (N, n, 6).
    """
    size, n, duration = coefficients.shape[0], coefficients.shape[1], given[-1]
    spans, shares = np.empty(size), np.empty(_POINTS)
    for i in range(size):
        spans[i] = breaks[i + 1] - breaks[i]
    times = np.empty(2 + size * _POINTS)
    times[0], times[1] = 0.0, duration
    for p in range(_POINTS):
        shares[p] = (p + 0.5) / _POINTS
        for i in range(size):
            times[2 + i * _POINTS + p] = min(breaks[i] + shares[p] * spans[i], duration)
    sampled = np.empty((2 + size * _POINTS, n))
    sample_kernel(given, pieces, times, 0, sampled)
    points = sampled[2:].reshape((size, _POINTS, n))
    fit_spans_kernel(points, shares, sampled[:2], limits, loads, spans, coefficients)
    breaks[0] = 0.0
    for i in range(size):
        breaks[i + 1] = breaks[i] + spans[i]
    return fit_kernel(breaks, coefficients, limits)


@kernel
def fit_spans_kernel(
    points: Array,
    shares: Array,
    ends: Array,
    limits: Array,
    loads: SpanLoads,
    spans: Array,
    coefficients: Array,
) -> float:
    """Write the spans and the coefficients of the fastest spline of all rounds; its excess.

    Args:
        points: Points to be passed, by span, shape (N, p, n).
        shares: Places of the points in their span, in (0, 1), shape (p,).
        ends: Positions at rest, shape (2, n).
        limits: Limits of velocity, acceleration and jerk, shape (3, n).
        loads: Limits of torques and of the tool's speed.
        spans: First guess and answer, shape (N,) [s].
        coefficients: Ascending powers of the time in the span, shape (N, n, 6).

    Returns:
        Factor by which the motion has to be made longer to keep the limits at the places checked.
    """
    size, count, n = points.shape
    width = -(-n // LANES) * LANES
    wide_points, wide_ends = np.zeros((size, count, width)), np.zeros((2, width))
    wide_points[:, :, :n], wide_ends[:, :n] = points, ends
    # Joints that are none keep every limit.
    rates = np.zeros((3, width))
    rates[:, :n] = 1.0 / limits
    room = least_squares_memory(size, count, width)
    trial, best = np.empty((size, ORDER, width)), np.empty((size, ORDER, width))
    excess, smooth = np.empty(size), np.empty(size)
    lengths = spans.copy()
    fastest, factor = np.inf, np.inf
    # Exponent of the excess by which a span is made longer or shorter in a round.
    space, step = span_memory(n), 0.6
    is_loaded = loads.tool > 0.0 or loads.torques.shape[0] > 0
    if is_loaded:
        # The same where there are loads: they bind here and there.
        step = 0.8
    # Rounds of fitting; more gain less than a hundredth.
    for _ in range(8):
        fit_points(room, wide_points, shares, wide_ends, lengths, trial)
        _excess_kernel(trial, lengths, rates, excess)
        if is_loaded:
            widen_for_loads_kernel(trial, lengths, loads, _PLACES, space, excess)
        worst, duration = 0.0, 0.0
        for i in range(size):
            worst = max(worst, excess[i])
            duration += lengths[i]
        if worst * duration < fastest:
            fastest, factor = worst * duration, worst
            spans[:] = lengths
            trial, best = best, trial
        for i in range(size):
            # A span becomes shorter by this factor of its excess at most: limits hardly matter
            # where it rests.
            lengths[i] *= max(excess[i], 0.3 * worst) ** step
        total = 0.0
        for i in range(size):
            before, after = lengths[max(i - 1, 0)], lengths[min(i + 1, size - 1)]
            smooth[i] = 0.75 * lengths[i] + 0.125 * (before + after)
            total += smooth[i]
        for i in range(size):
            lengths[i] = smooth[i] * worst * duration / total
    for i in range(size):
        for joint in range(n):
            for k in range(ORDER):
                coefficients[i, joint, k] = best[i, k, joint]
    return factor


@kernel(allocates=False)
def _excess_kernel(pieces: Array, spans: Array, rates: Array, excess: Array) -> None:
    """Write by which factor each span is too short for 1 / ``rates`` (3, n') at places in it."""
    size, width = pieces.shape[0], pieces.shape[2]
    for i in range(size):
        velocity, acceleration, jerk = 0.0, 0.0, 0.0
        for block in range(0, width, LANES):
            c1, c2, c3 = (
                load(pieces[i, 1], block),
                load(pieces[i, 2], block),
                load(pieces[i, 3], block),
            )
            c4, c5 = load(pieces[i, 4], block), load(pieces[i, 5], block)
            v1, v2, v3, v4 = 2.0 * c2, 3.0 * c3, 4.0 * c4, 5.0 * c5
            a1, a2, a3, j1, j2 = 6.0 * c3, 12.0 * c4, 20.0 * c5, 24.0 * c4, 60.0 * c5
            fastest, strongest, roughest = fill(0.0), fill(0.0), fill(0.0)
            for place in range(_PLACES):
                t = spans[i] * place / (_PLACES - 1)
                v = c1 + (v1 + (v2 + (v3 + v4 * t) * t) * t) * t
                a = v1 + (a1 + (a2 + a3 * t) * t) * t
                j = a1 + (j1 + j2 * t) * t
                fastest, strongest = max(fastest, abs(v)), max(strongest, abs(a))
                roughest = max(roughest, abs(j))
            fastest = fastest * load(rates[0], block)
            strongest = strongest * load(rates[1], block)
            roughest = roughest * load(rates[2], block)
            velocity = max(velocity, _largest_lane(fastest))
            acceleration = max(acceleration, _largest_lane(strongest))
            jerk = max(jerk, _largest_lane(roughest))
        excess[i] = max(velocity, math.sqrt(acceleration), jerk ** (1.0 / 3.0))


@kernel(inline="code", allocates=False)
def _largest_lane(value: Lanes) -> float:
    """The largest number of a vector."""
    largest = lane(value, 0)
    for number in range(1, LANES):
        largest = max(largest, lane(value, number))
    return largest
