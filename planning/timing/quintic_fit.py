"""A quintic spline of time near a motion, in few pieces, with spans as long as limits need.

The spline is fitted by least squares to points of the motion, the same points of the path all the
time; its ends are at rest. Where its velocity, acceleration or jerk exceeds a limit the span is
made longer, elsewhere shorter, until the limits are used everywhere alike. A spline rounds corners
by some milliradians more than the motion: whether it is free is for the proof to say.
"""

import math
from collections.abc import Sequence

import numpy as np

from kinematics.arrays import Array
from kinematics.compiled.kernel import kernel
from kinematics.errors import InvalidOption
from kinematics.polynomial import sample_kernel
from kinematics.trajectory import Trajectory
from planning.timing.banded_cholesky import solve_wide_band_kernel
from planning.timing.time_scaling import ScaledTime, fit_kernel, scaled_motion

#: Degree of the spline: four derivatives are continuous.
DEGREE = 5
#: Spans for each second of a motion that are tried in turn [1/s]: 13 and 20 pieces in 1.6 s. With
#: more it keeps nearer to the path and takes a few per cent longer.
SPAN_RATES = (8.0, 12.0)
#: Spans, at least.
MIN_SPANS = 6
# Spans, at most, for each leg of the path: slow motions need no more than fast ones.
_SPANS_PER_LEG = 6
# Points of the motion in each span that the spline is fitted to.
_POINTS = 6
# Places in each span at which limits are looked at while its length is sought.
_PLACES = 9
# Rounds of fitting; more gain less than a hundredth.
_ROUNDS = 8
# Exponent of the excess by which a span is made longer or shorter in a round.
_STEP = 0.6
# A span becomes shorter by this factor of its excess at most: limits hardly matter where it rests.
_MIN_EXCESS = 0.3
# Control points at either end that rest there: position, velocity and acceleration.
_FIXED = 3


def fit_quintic(
    motion: Trajectory,
    joint_names: Sequence[str],
    limits: Array,
    legs: int,
    rate: float = SPAN_RATES[0],
) -> ScaledTime:
    """The quintic spline near a motion from rest to rest, as fast as its exact peaks allow.

    Args:
        motion: The motion.
        joint_names: n names.
        limits: Of velocity (inf where there is none), acceleration and jerk, shape (3, n).
        legs: Number of the straight legs of its path.
        rate: Spans for each second of the motion [1/s].

    Returns:
        The spline, and the factor by which its time was scaled at last.

    Raises:
        InvalidOption: A limit is not positive, or none bounds the motion.
    """
    count = max(MIN_SPANS, math.ceil(rate * motion.duration))
    count = min(count, max(MIN_SPANS, _SPANS_PER_LEG * legs))
    breaks, coefficients = np.empty(count + 1), np.empty((count, motion.n, DEGREE + 1))
    bounds = np.ascontiguousarray(limits, dtype=np.float64)
    if not (bounds > 0.0).all():
        raise InvalidOption("limits must be positive", hint="Give inf where there is none.")
    factor = fit_motion_kernel(motion.breaks, motion.coefficients, bounds, breaks, coefficients)
    return scaled_motion(joint_names, breaks, coefficients, factor)._replace(
        solver="quintic_spline"
    )


@kernel
def fit_motion_kernel(
    given: Array, pieces: Array, limits: Array, breaks: Array, coefficients: Array
) -> float:
    """Write breaks and coefficients of the spline near a motion; the factor of ``fit_kernel``.

    Args:
        given: Breaks of the motion, shape (m + 1,) [s].
        pieces: Its coefficients, shape (m, n, k).
        limits: Of velocity, acceleration and jerk, shape (3, n).
        breaks: Filled, shape (N + 1,) [s].
        coefficients: Filled, shape (N, n, 6).
    """
    size, n, duration = coefficients.shape[0], coefficients.shape[1], given[-1]
    spans, shares = np.full(size, duration / size), np.empty(_POINTS)
    times = np.empty(2 + size * _POINTS)
    times[0], times[1] = 0.0, duration
    for p in range(_POINTS):
        shares[p] = (p + 0.5) / _POINTS
        for i in range(size):
            times[2 + i * _POINTS + p] = min((i + shares[p]) * spans[i], duration)
    sampled = np.empty((2 + size * _POINTS, n))
    sample_kernel(given, pieces, times, 0, sampled)
    points = sampled[2:].reshape((size, _POINTS, n))
    fit_spans_kernel(points, shares, sampled[:2], limits, spans, coefficients)
    breaks[0] = 0.0
    for i in range(size):
        breaks[i + 1] = breaks[i] + spans[i]
    return fit_kernel(breaks, coefficients, limits)


@kernel
def fit_spans_kernel(
    points: Array, shares: Array, ends: Array, limits: Array, spans: Array, coefficients: Array
) -> float:
    """Write the spans and the coefficients of the fastest spline of all rounds; its excess.

    Args:
        points: To be passed, by span, shape (N, p, n).
        shares: Places of the points in their span, in (0, 1), shape (p,).
        ends: Positions at rest, shape (2, n).
        limits: Of velocity, acceleration and jerk, shape (3, n).
        spans: First guess and answer, shape (N,) [s].
        coefficients: Ascending powers of the time in the span, shape (N, n, 6).

    Returns:
        Factor by which the motion has to be made longer to keep the limits at the places looked at.
    """
    size, n = points.shape[0], points.shape[2]
    bases = np.empty((size, DEGREE + 1, DEGREE + 1))
    trial, excess = np.empty((size, n, DEGREE + 1)), np.empty(size)
    lengths, smooth, rates = spans.copy(), np.empty(size), 1.0 / limits
    fastest, factor = np.inf, np.inf
    for _ in range(_ROUNDS):
        bases_kernel(lengths, bases)
        _fit_kernel(points, shares, ends, lengths, bases, trial)
        _excess_kernel(trial, lengths, rates, excess)
        worst, duration = 0.0, 0.0
        for i in range(size):
            worst = max(worst, excess[i])
            duration += lengths[i]
        if worst * duration < fastest:
            fastest, factor = worst * duration, worst
            spans[:], coefficients[:] = lengths, trial
        for i in range(size):
            lengths[i] *= max(excess[i], _MIN_EXCESS * worst) ** _STEP
        total = 0.0
        for i in range(size):
            before, after = lengths[max(i - 1, 0)], lengths[min(i + 1, size - 1)]
            smooth[i] = 0.75 * lengths[i] + 0.125 * (before + after)
            total += smooth[i]
        for i in range(size):
            lengths[i] = smooth[i] * worst * duration / total
    return factor


@kernel
def bases_kernel(spans: Array, bases: Array) -> None:
    """Write the basis functions of a clamped quintic spline as polynomials of the time in a span.

    Args:
        spans: Shape (N,) [s].
        bases: The k-th coefficient of the j-th function that is not zero in span i, shape
            (N, 6, 6): bases[i, j, k].
    """
    size = spans.shape[0]
    knots = np.empty(size + 2 * DEGREE + 1)
    knots[: DEGREE + 1] = 0.0
    for i in range(size):
        knots[DEGREE + 1 + i] = knots[DEGREE + i] + spans[i]
    knots[DEGREE + 1 + size :] = knots[DEGREE + size]
    for i in range(size):
        at, table = i + DEGREE, bases[i]
        table[:] = 0.0
        table[0, 0] = 1.0
        for p in range(1, DEGREE + 1):
            # From the last function down: each is made of itself and the one before.
            for j in range(p, -1, -1):
                first = at - p + j
                rise, away, fall, left = 0.0, 0.0, 0.0, 0.0
                if j > 0:
                    rise = 1.0 / (knots[first + p] - knots[first])
                    away = knots[at] - knots[first]
                if j < p:
                    fall = 1.0 / (knots[first + p + 1] - knots[first + 1])
                    left = knots[first + p + 1] - knots[at]
                for k in range(p, -1, -1):
                    value = 0.0
                    if j > 0:
                        before = table[j - 1, k - 1] if k > 0 else 0.0
                        value += (before + away * table[j - 1, k]) * rise
                    if j < p:
                        before = table[j, k - 1] if k > 0 else 0.0
                        value += (left * table[j, k] - before) * fall
                    table[j, k] = value


@kernel
def _fit_kernel(
    points: Array, shares: Array, ends: Array, spans: Array, bases: Array, coefficients: Array
) -> None:
    """Write the coefficients of the spline of least squares that rests at both ends."""
    size, n = points.shape[0], points.shape[2]
    unknown = size + DEGREE - 2 * _FIXED
    control = np.zeros((size + DEGREE, n))
    for row in range(_FIXED):
        control[row] = ends[0]
        control[size + DEGREE - 1 - row] = ends[1]
    band, right = np.zeros((unknown, DEGREE + 1)), np.zeros((unknown, n))
    _normal_equations_kernel(points, shares, spans, bases, control, band, right)
    solve_wide_band_kernel(band, right)
    control[_FIXED : _FIXED + unknown] = right
    for i in range(size):
        for joint in range(n):
            for k in range(DEGREE + 1):
                value = 0.0
                for j in range(DEGREE + 1):
                    value += bases[i, j, k] * control[i + j, joint]
                coefficients[i, joint, k] = value


@kernel
def _normal_equations_kernel(
    points: Array,
    shares: Array,
    spans: Array,
    bases: Array,
    control: Array,
    band: Array,
    right: Array,
) -> None:
    """Add up the normal equations of the control points between the fixed ones.

    Args:
        points: Shape (N, p, n).
        shares: Shape (p,).
        spans: Shape (N,) [s].
        bases: Shape (N, 6, 6).
        control: Control points, 0 where unknown, shape (N + 5, n).
        band: Matrix for ``solve_wide_band_kernel``, comes as zeros, shape (N - 1, 6).
        right: Right-hand sides, come as zeros, shape (N - 1, n).
    """
    size, count, n = points.shape
    values, target = np.empty(DEGREE + 1), np.empty(n)
    for i in range(size):
        # Functions of free control points are in the middle; the others' parts are known.
        low, high = max(0, _FIXED - i), min(DEGREE, right.shape[0] - 1 + _FIXED - i)
        for p in range(count):
            place = shares[p] * spans[i]
            target[:] = points[i, p]
            for j in range(DEGREE + 1):
                value = 0.0
                for k in range(DEGREE, -1, -1):
                    value = value * place + bases[i, j, k]
                values[j] = value
                if not low <= j <= high:
                    for joint in range(n):
                        target[joint] -= value * control[i + j, joint]
            for j in range(low, high + 1):
                row, value = i + j - _FIXED, values[j]
                for other in range(low, j + 1):
                    band[row, j - other] += value * values[other]
                for joint in range(n):
                    right[row, joint] += value * target[joint]


@kernel(allocates=False)
def _excess_kernel(coefficients: Array, spans: Array, rates: Array, excess: Array) -> None:
    """Write by which factor each span is too short for 1 / ``rates`` (3, n) at places in it."""
    size, n = coefficients.shape[:2]
    for i in range(size):
        velocity, acceleration, jerk = 0.0, 0.0, 0.0
        for place in range(_PLACES):
            t = spans[i] * place / (_PLACES - 1)
            for joint in range(n):
                c = coefficients[i, joint]
                v = c[1] + (2.0 * c[2] + (3.0 * c[3] + (4.0 * c[4] + 5.0 * c[5] * t) * t) * t) * t
                a = 2.0 * c[2] + (6.0 * c[3] + (12.0 * c[4] + 20.0 * c[5] * t) * t) * t
                j = 6.0 * c[3] + (24.0 * c[4] + 60.0 * c[5] * t) * t
                velocity = max(velocity, abs(v) * rates[0, joint])
                acceleration = max(acceleration, abs(a) * rates[1, joint])
                jerk = max(jerk, abs(j) * rates[2, joint])
        excess[i] = max(velocity, math.sqrt(acceleration), jerk ** (1.0 / 3.0))
