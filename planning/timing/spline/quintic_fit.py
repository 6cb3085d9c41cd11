"""A quintic spline of time near a motion, in few pieces, with spans as long as limits need.

The spline is fitted by least squares to points of the motion, the same points of the path all the
time; its ends are at rest. Where its velocity, acceleration or jerk exceeds a limit the span is
made longer, elsewhere shorter, until the limits are used everywhere alike. A spline rounds corners
by some milliradians more than the motion: whether it is free is for the proof to say.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from compiled.kernel import direct, kernel
from compiled.simd import LANES, fill, load
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.trajectory.polynomial import sample_kernel
from kinematics.trajectory.trajectory import Trajectory
from planning.timing.jerk.even_corners import Pieces
from planning.timing.limit_ratios import largest_lane
from planning.timing.spline.quintic_basis import DEGREE, ORDER, fit_points, least_squares_memory
from planning.timing.spline.span_loads import (
    SpanLoads,
    no_loads,
    span_memory,
    widen_for_loads_kernel,
)
from planning.timing.time_scaling import ScaledTime, fit_kernel, scaled_motion

#: Spans for each second of a motion that are tried in turn [1/s]: 13 and 20 pieces in 1.6 s. With
#: more it keeps nearer to the path and takes a few per cent longer.
SPAN_RATES = (8.0, 12.0)
#: Spans, at least.
MIN_SPANS = 6
# Points of the motion in each span that the spline is fitted to.
_POINTS = 6
# Places in each span at which limits are checked while its length is sought.
_PLACES = 9


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
        limits: Limits of velocity (inf where there is none), acceleration and jerk, shape (3, n).
        legs: Number of the straight legs of its path.
        rate: Spans for each second of the motion [1/s].

    Returns:
        The spline, and the factor by which its time was scaled at last.

    Raises:
        InvalidOption: A limit is not positive, or none bounds the motion.
    """
    bounds = np.ascontiguousarray(limits, dtype=np.float64)
    if not (bounds > 0.0).all():
        raise InvalidOption("limits must be positive", hint="Give inf where there is none.")
    pieces = Pieces(motion.breaks, motion.coefficients)
    return fit_pieces(pieces, joint_names, bounds, even_parts(motion.duration, legs, rate))


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
        count = min(count, max(MIN_SPANS, 6 * legs))
    return np.asarray(np.arange(count + 1) * (duration / count))


def fit_pieces(
    motion: Pieces,
    joint_names: Sequence[str],
    limits: Array,
    parts: Array,
    loads: SpanLoads | None = None,
) -> ScaledTime:
    """``fit_quintic`` near pieces that nothing has checked, within limits that are positive.

    Args:
        motion: The pieces.
        joint_names: n names.
        limits: Limits of velocity, acceleration and jerk, shape (3, n).
        parts: Ends of the parts of the motion that the N spans are fitted to, shape (N + 1,) [s].
        loads: Limits that spans are made longer for. They are nearly kept: the motion is as fast as
            the limits of its joints allow.
    """
    n, count = motion.coefficients.shape[1], len(parts) - 1
    breaks, coefficients = parts.copy(), np.empty((count, n, DEGREE + 1))
    factor = _fit_motion()(*motion, limits, loads or no_loads(), breaks, coefficients)
    scaled = scaled_motion(joint_names, breaks, coefficients, factor)
    return ScaledTime(scaled.trajectory, factor, "quintic_spline")


@cache
def _fit_motion() -> Callable[[Array, Array, Array, SpanLoads, Array, Array], float]:
    """``fit_motion_kernel`` for pieces' arrays, without numba's check of their types."""
    breaks, coefficients = np.zeros(1), np.zeros((1, 1, 1))
    return direct(
        fit_motion_kernel, breaks, coefficients, np.zeros((3, 1)), no_loads(), breaks, coefficients
    )


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
    lengths = np.ones(-(-size // LANES) * LANES)
    lengths[:size] = spans
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
            spans[:] = lengths[:size]
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
            velocity = max(velocity, largest_lane(fastest))
            acceleration = max(acceleration, largest_lane(strongest))
            jerk = max(jerk, largest_lane(roughest))
        excess[i] = max(velocity, math.sqrt(acceleration), jerk ** (1.0 / 3.0))
