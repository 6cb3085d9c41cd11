"""Motion along a polyline with rounded corners in few cubic pieces: double-S legs, even corners.

Straight legs are run through in the least time that a bounded jerk allows between the speeds of
their ends, by ramps of at most three phases of constant jerk ("Trajectory Planning for Automatic
Machines and Robots", 2008, section 3.4). Corners rounded by cubics are passed at constant speed.
Acceleration is continuous, q(t) cubic in every piece, and all limits hold by construction.

Along a leg with limits V, A, J a ramp between the speeds v < w takes the time

    T(w - v) = 2 sqrt((w - v) / J) where (w - v) J <= A^2, else (w - v) / A + A / J

and the way (v + w) T / 2. Speeds of corners are lowered, forwards and backwards, to what the legs
leave room for; then each leg has a highest speed p between them, which its length determines.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array
from planning.timing.options import TimingFailed

#: A speed is found when a step changes it by less than this part.
CONVERGED = 1e-15
#: Phases of a leg, at most: two ramps of three and a stretch at constant speed.
MAX_PHASES = 7


class Legs(NamedTuple):
    """Straight legs with limits along them.

    Args:
        lengths: Shape (m,) [rad or m].
        limits: Limits of speed (inf for none), acceleration and jerk along each, shape (m, 3).
    """

    lengths: Array
    limits: Array


@kernel(inline="code", allocates=False)
def ramp_time(change: float, acceleration: float, jerk: float) -> float:
    """Least time of a change of speed with no acceleration at its ends [s].

    Args:
        change: Change of speed, at least 0.
        acceleration: Largest one.
        jerk: Largest one.
    """
    if change * jerk <= acceleration * acceleration:
        return 2.0 * math.sqrt(change / jerk)
    return change / acceleration + acceleration / jerk


@kernel(inline="code", allocates=False)
def _ramp_length(low: float, high: float, acceleration: float, jerk: float) -> float:
    return 0.5 * (low + high) * ramp_time(high - low, acceleration, jerk)


@kernel(inline="code", allocates=False)
def _ramp_slope(low: float, high: float, acceleration: float, jerk: float) -> float:
    """Derivative of a ramp's length by its higher speed; inf where both speeds are the same."""
    change, rate = high - low, 1.0 / acceleration
    if change * jerk <= acceleration * acceleration:
        rate = 1.0 / math.sqrt(max(change * jerk, 1e-300))
    return 0.5 * ramp_time(change, acceleration, jerk) + 0.5 * (low + high) * rate


@kernel(inline="code", allocates=False)
def _excess(
    start: float, end: float, speed: float, length: float, limits: Array, alike: bool
) -> float:
    """By how much the ramps to a speed from both ends of a leg are longer than it."""
    ramp = _ramp_length(start, speed, limits[1], limits[2])
    other = ramp if alike else _ramp_length(end, speed, limits[1], limits[2])
    return ramp + other - length


@kernel(allocates=False)
def _peak_speed(
    start: float, end: float, length: float, limits: Array, tolerance: float, alike: bool
) -> float:
    """``peak_speed``; ``alike`` says that both ends have the same speed, which halves the work."""
    v, a, j = float(limits[0]), float(limits[1]), float(limits[2])
    low = max(start, end)
    # Lengths that differ by less than this part are the same.
    if _excess(start, end, low, 0.0, limits, alike) >= (1.0 - 1e-13) * length:
        return low
    high = v
    if not v < np.inf:
        # From rest half the leg is run through in more time than this, at the least acceleration.
        high = low + math.sqrt(2.0 * a * length) + length * math.sqrt(a / length) + 1e-12
    if not _excess(start, end, high, length, limits, alike) > 0.0:
        return high
    below, above = low, high
    speed = 0.5 * (below + above)
    # Steps of Newton's method, safeguarded by bisection: eight are usual.
    for _ in range(80):
        excess = _excess(start, end, speed, length, limits, alike)
        if excess > 0.0:
            above = speed
        else:
            below = speed
        slope = _ramp_slope(start, speed, a, j)
        slope += slope if alike else _ramp_slope(end, speed, a, j)
        better = speed - excess / slope
        if not below < better < above:
            better = 0.5 * (below + above)
        change, speed = abs(better - speed), better
        if change <= tolerance * speed:
            break
    return speed


@kernel(allocates=False)
def peak_speed(start: float, end: float, length: float, limits: Array, tolerance: float) -> float:
    """Largest speed of a leg that is begun and ended at given speeds; the larger if none is higher.

    Args:
        start: Speed at its start.
        end: Speed at its end.
        length: Length of the leg.
        limits: Limits of speed, acceleration and jerk along it, shape (3,).
        tolerance: Error of the speed, as a part of it.
    """
    return _peak_speed(start, end, length, limits, tolerance, False)


@kernel(allocates=False)
def reachable_speed(start: float, length: float, limits: Array, tolerance: float) -> float:
    """The largest speed that a leg allows at its end."""
    return _peak_speed(start, start, 2.0 * length, limits, tolerance, True)


@kernel(allocates=False)
def leg_time(start: float, end: float, length: float, limits: Array, tolerance: float) -> float:
    """Least time of a leg between two speeds that it leaves room for [s]."""
    if not length > 0.0:
        return 0.0
    peak = peak_speed(start, end, length, limits, tolerance)
    a, j = float(limits[1]), float(limits[2])
    ramps = _ramp_length(start, peak, a, j) + _ramp_length(end, peak, a, j)
    time = ramp_time(peak - start, a, j) + ramp_time(peak - end, a, j)
    return time + max(length - ramps, 0.0) / peak


@kernel(allocates=False)
def lower_speeds_kernel(legs: Legs, speeds: Array, tolerance: float) -> float:
    """Lower the speeds between legs to what they leave room for; the time of all legs [s].

    Args:
        legs: m legs.
        speeds: Speeds at the start, between the legs and at the end; the largest ones come in, the
            possible ones go out, shape (m + 1,).
        tolerance: Error of a speed, as a part of it.
    """
    m = legs.lengths.shape[0]
    for i in range(m):
        if speeds[i + 1] > speeds[i]:
            length, limits = legs.lengths[i], legs.limits[i]
            reachable = reachable_speed(speeds[i], length, limits, tolerance)
            speeds[i + 1] = min(speeds[i + 1], reachable)
    for i in range(m - 1, -1, -1):
        if speeds[i] > speeds[i + 1]:
            length, limits = legs.lengths[i], legs.limits[i]
            reachable = reachable_speed(speeds[i + 1], length, limits, tolerance)
            speeds[i] = min(speeds[i], reachable)
    time = 0.0
    for i in range(m):
        start, end = speeds[i], speeds[i + 1]
        time += leg_time(start, end, legs.lengths[i], legs.limits[i], tolerance)
    return time


@kernel(inline="code", allocates=False)
def _are_same(low: float, high: float) -> bool:
    """Whether no ramp lies between two speeds."""
    # Speeds that differ by less than this part are the same: a ramp goes by the square root of
    # their difference, whose rounding would be seen as a jump.
    return abs(high - low) <= 1e-11 * max(low, high)


@kernel(allocates=False)
def _write_ramp(
    place: float, start: float, end: float, limits: Array, least: float, phases: Array, used: int
) -> int:
    """Write the phases of a ramp from a place on, after ``used`` others; their number then."""
    change, a, j = abs(end - start), limits[1], limits[2]
    sign = 1.0 if end > start else -1.0
    if _are_same(start, end):
        return used
    even = 0.0
    if change * j > a * a:
        even = change / a - a / j
    bend = a / j if even > 0.0 else math.sqrt(change / j)
    s, v, rate = place, start, 0.0
    for phase in range(3):
        h = even if phase == 1 else bend
        jerk = sign * j * (1.0 - phase)
        if h <= least:
            continue
        row = phases[used]
        row[0], row[1], row[2], row[3], row[4] = s, v, 0.5 * rate, jerk / 6.0, h
        s += (v + (0.5 * rate + jerk * h / 6.0) * h) * h
        v += (rate + 0.5 * jerk * h) * h
        rate += jerk * h
        used += 1
    return used


@kernel(allocates=False)
def leg_phases_kernel(start: float, end: float, length: float, limits: Array, phases: Array) -> int:
    """Write (place, speed, acceleration / 2, jerk / 6, duration) of a leg's phases; their number.

    Args:
        start: Speed at its start.
        end: Speed at its end; the leg leaves room for both.
        length: Length of the leg.
        limits: Limits of speed, acceleration and jerk along it, shape (3,).
        phases: Room for ``MAX_PHASES`` rows of 5.
    """
    a, j = limits[1], limits[2]
    peak = peak_speed(start, end, length, limits, CONVERGED)
    # Phases that take less than this part of their leg's time are rounding: no pieces.
    least = 1e-12 * leg_time(start, end, length, limits, CONVERGED)
    rising = 0.0 if _are_same(start, peak) else _ramp_length(start, peak, a, j)
    falling = 0.0 if _are_same(end, peak) else _ramp_length(end, peak, a, j)
    used = _write_ramp(0.0, start, peak, limits, least, phases, 0)
    even = (length - rising - falling) / peak
    if even > least:
        row = phases[used]
        row[0], row[1], row[2], row[3], row[4] = rising, peak, 0.0, 0.0, even
        used += 1
    # From the leg's end backwards, so that it is met to the last bit.
    return _write_ramp(length - falling, peak, end, limits, least, phases, used)


@kernel
def polyline_phases_kernel(
    lengths: Array,
    straight: NDArray[np.bool_],
    limits: Array,
    speeds: Array,
    phases: Array,
    owners: NDArray[np.int64],
) -> int:
    """Write the phases of a path of straight pieces and curves at constant speed; their number.

    Args:
        lengths: Lengths of the path's pieces, shape (p,).
        straight: Marks of those that are straight, shape (p,).
        limits: Limits along the straight ones, shape (p, 3).
        speeds: Speeds at the start, between the pieces and at the end, shape (p + 1,).
        phases: Shape (>= MAX_PHASES p, 5).
        owners: The path's piece of each phase, shape (>= MAX_PHASES p,).
    """
    used = 0
    for i in range(lengths.shape[0]):
        before = used
        if straight[i]:
            rows = phases[used:]
            used += leg_phases_kernel(speeds[i], speeds[i + 1], lengths[i], limits[i], rows)
        else:
            row = phases[used]
            row[0], row[1], row[2], row[3], row[4] = 0.0, speeds[i], 0.0, 0.0, 0.0
            row[4] = lengths[i] / speeds[i]
            used += 1
        for phase in range(before, used):
            owners[phase] = i
    return used


def line_phases(
    length: float, limits: ArrayLike, start_speed: float = 0.0, end_speed: float = 0.0
) -> Array:
    """The fastest motion along a line of some length, at most seven phases of constant jerk.

    Args:
        length: Length of the line, positive.
        limits: Limits of speed (inf for none), acceleration and jerk along it, shape (3,).
        start_speed: Start speed along the line, not negative.
        end_speed: End speed along the line; the acceleration is 0 at both ends.

    Returns:
        (place, speed, acceleration / 2, jerk / 6, duration) of each phase, shape (m, 5).

    Raises:
        TimingFailed: There is no such motion, say since the line is too short to slow down on.
    """
    along = np.array(limits, dtype=np.float64)
    low, high = sorted((start_speed, end_speed))
    ramp = 0.5 * (low + high) * ramp_time(high - low, along[1], along[2])
    # Speeds and lengths may exceed what there is room for by rounding.
    if high > along[0] * (1.0 + 1e-12) or ramp > length * (1.0 + 1e-12):
        raise TimingFailed(
            f"a line of {length:.6g} leaves no room to get from a speed of {start_speed:.6g} to "
            f"{end_speed:.6g} within its limits",
            hint="Give lower boundary velocities, or higher limits.",
        )
    along[0] = max(along[0], high)
    phases = np.empty((MAX_PHASES, 5))
    return phases[: leg_phases_kernel(start_speed, end_speed, length, along, phases)]
