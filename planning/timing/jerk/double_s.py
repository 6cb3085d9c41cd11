"""Straight legs run through in the least time that a bounded jerk allows, in closed form.

A ramp leads from one speed to another in at most three phases of constant jerk ("Trajectory
Planning for Automatic Machines and Robots", 2008, section 3.4). With limits V, A, J along the leg
one between the speeds v < w takes the time

    T(w - v) = 2 sqrt((w - v) / J) where (w - v) J <= A^2, else (w - v) / A + A / J

and the way (v + w) T / 2. A leg has a highest speed between its ends, which its length determines.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from compiled.kernel import kernel
from kinematics.arrays import Array
from planning.timing.options import TimingFailed

#: Phases of a leg, at most: two ramps of three and a stretch at constant speed.
MAX_PHASES = 7


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
def ramp_length(low: float, high: float, acceleration: float, jerk: float) -> float:
    """Way of a change of speed with no acceleration at its ends."""
    return 0.5 * (low + high) * ramp_time(high - low, acceleration, jerk)


@kernel(inline="code", allocates=False)
def _ramp_slope(low: float, high: float, acceleration: float, jerk: float) -> float:
    """Derivative of a ramp's length by its higher speed; inf where both speeds are the same."""
    change, rate = high - low, 1.0 / acceleration
    if change * jerk <= acceleration * acceleration:
        rate = 1.0 / math.sqrt(max(change * jerk, 1e-300))
    return 0.5 * ramp_time(change, acceleration, jerk) + 0.5 * (low + high) * rate


@kernel(inline="code", allocates=False)
def _excess(start: float, end: float, speed: float, length: float, limits: Array) -> float:
    """By how much the ramps to a speed from both ends of a leg are longer than it."""
    ramp = ramp_length(start, speed, limits[1], limits[2])
    return ramp + ramp_length(end, speed, limits[1], limits[2]) - length


@kernel(allocates=False)
def peak_speed(start: float, end: float, length: float, limits: Array) -> float:
    """Largest speed of a leg that is begun and ended at given speeds; the larger if none is higher.

    Args:
        start: Speed at its start.
        end: Speed at its end.
        length: Length of the leg.
        limits: Limits of speed, acceleration and jerk along it, shape (3,).
    """
    v, a, j = float(limits[0]), float(limits[1]), float(limits[2])
    low = max(start, end)
    # Lengths that differ by less than this part are the same.
    if _excess(start, end, low, 0.0, limits) >= (1.0 - 1e-13) * length:
        return low
    high = v
    if not v < np.inf:
        # From rest half the leg is run through in more time than this, at the least acceleration.
        high = low + math.sqrt(2.0 * a * length) + length * math.sqrt(a / length) + 1e-12
    if not _excess(start, end, high, length, limits) > 0.0:
        return high
    below, above = low, high
    speed = 0.5 * (below + above)
    # Steps of Newton's method, safeguarded by bisection: eight are usual.
    for _ in range(80):
        excess = _excess(start, end, speed, length, limits)
        if excess > 0.0:
            above = speed
        else:
            below = speed
        slope = _ramp_slope(start, speed, a, j) + _ramp_slope(end, speed, a, j)
        better = speed - excess / slope
        if not below < better < above:
            better = 0.5 * (below + above)
        change, speed = abs(better - speed), better
        # A speed is found when a step changes it by less than this part.
        if change <= 1e-15 * speed:
            break
    return speed


@kernel(inline="code", allocates=False)
def are_same(low: float, high: float) -> bool:
    """Whether no ramp lies between two speeds."""
    # Speeds that differ by less than this part are the same: a ramp goes by the square root of
    # their difference, whose rounding would be seen as a jump.
    return abs(high - low) <= 1e-11 * max(low, high)


@kernel(allocates=False)
def write_ramp(
    place: float, start: float, end: float, limits: Array, least: float, phases: Array, used: int
) -> int:
    """Write the phases of a ramp from a place on, after ``used`` others; their number then."""
    change, a, j = abs(end - start), limits[1], limits[2]
    sign = 1.0 if end > start else -1.0
    if are_same(start, end):
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
    peak = peak_speed(start, end, length, limits)
    rising = 0.0 if are_same(start, peak) else ramp_length(start, peak, a, j)
    falling = 0.0 if are_same(end, peak) else ramp_length(end, peak, a, j)
    even = (length - rising - falling) / peak
    # Phases that take less than this part of their leg's time are rounding: no pieces.
    ramps = ramp_time(peak - start, a, j) + ramp_time(peak - end, a, j)
    least = 1e-12 * (ramps + max(even, 0.0))
    used = write_ramp(0.0, start, peak, limits, least, phases, 0)
    if even > least:
        row = phases[used]
        row[0], row[1], row[2], row[3], row[4] = rising, peak, 0.0, 0.0, even
        used += 1
    # From the leg's end backwards, so that it is met to the last bit.
    return write_ramp(length - falling, peak, end, limits, least, phases, used)


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
    ramp = ramp_length(low, high, along[1], along[2])
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


@kernel(allocates=False)
def moving_leg_kernel(
    start: tuple[float, float],
    end: tuple[float, float],
    length: float,
    limits: Array,
    phases: Array,
) -> int:
    """Write the phases of a leg between two speeds with accelerations; their number, 0 for none.

    The jerk is at its limit at both ends, upwards or downwards: the fastest of the four motions.

    Args:
        start: Speed and acceleration at its start.
        end: Speed and acceleration at its end.
        length: Length of the leg.
        limits: Limits of speed, acceleration and jerk along it, shape (3,).
        phases: Room for ``MAX_PHASES`` + 2 rows of 5.
    """
    fastest, best, used = np.inf, 0, 0
    for number in range(5):
        chosen = number if number < 4 else best
        first, last = 1.0 - 2.0 * (chosen % 2), 1.0 - 2.0 * (chosen // 2)
        used = _extended_leg(start, end, (first, last), length, limits, phases)
        time = 0.0
        for i in range(used):
            time += phases[i, 4]
        if used > 0 and time < fastest:
            fastest, best = time, chosen
    return used if fastest < np.inf else 0


@kernel(allocates=False)
def _extended_leg(
    start: tuple[float, float],
    end: tuple[float, float],
    signs: tuple[float, float],
    length: float,
    limits: Array,
    phases: Array,
) -> int:
    """``moving_leg_kernel`` with the signs of the jerk at both ends.

    With the jerk J an acceleration a is 0 a / J before, or -a / J later where that is negative.
    Between the places without acceleration lies a usual leg. Its end is a start run through
    backwards.
    """
    up, down = signs[0] * limits[2], signs[1] * limits[2]
    rise, fall = start[1] / up, -end[1] / down
    low, high = start[0] - 0.5 * up * rise * rise, end[0] - 0.5 * down * fall * fall
    before = (low + up * rise * rise / 6.0) * rise
    after = (high + down * fall * fall / 6.0) * fall
    whole, ends = length + before + after, max(start[0], end[0])
    if min(low, high) < -1e-12 * ends or max(low, high) > limits[0] or not whole > 0.0:
        return 0
    low, high = max(low, 0.0), max(high, 0.0)
    if ramp_length(min(low, high), max(low, high), limits[1], limits[2]) > whole:
        return 0
    # Phases shorter than this are rounding.
    least = 1e-12 * whole / max(ends, (limits[2] * whole * whole) ** (1.0 / 3.0))
    used: int = 0
    if rise < -least:
        row = phases[0]
        row[0], row[1], row[2], row[3], row[4] = 0.0, start[0], 0.5 * start[1], up / 6.0, -rise
        used = 1
    own = phases[used : used + leg_phases_kernel(low, high, whole, limits, phases[used:])]
    used += own.shape[0]
    if own.shape[0] == 0:
        return 0
    for row in own:
        row[0] -= before
    if rise > least:
        row = own[0]
        if not (row[3] * up > 0.0 and row[4] > rise + least):
            return 0
        row[0], row[1], row[2], row[4] = 0.0, start[0], 0.5 * start[1], row[4] - rise
    if fall > least:
        row = own[-1]
        if not (row[3] * down > 0.0 and row[4] > fall + least):
            return 0
        row[4] -= fall
    elif fall < -least:
        row = phases[used]
        row[0], row[1], row[2], row[3], row[4] = length + after, high, 0.0, down / 6.0, -fall
        used += 1
    return used
