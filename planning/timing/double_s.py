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
from numpy.typing import NDArray

from kinematics.arrays import Array
from kinematics.compiled.kernel import kernel

# Steps of Newton's method, safeguarded by bisection: eight are usual.
_MAX_STEPS = 80
#: A speed is found when a step changes it by less than this part.
CONVERGED = 1e-15
# The same while reaches are compared.
_ROUGH = 1e-4
# Phases that take less than this part of their leg's time are rounding: no pieces.
_NO_TIME = 1e-12
#: Phases of a leg, at most: two ramps of three and a stretch at constant speed.
MAX_PHASES = 7
# Speeds and lengths that differ by less than this part are the same: a ramp between them would be
# rounding, run through for its square root of a second.
_SAME = 1e-13
# Shares of the largest reach of a corner that are tried in turn; 0 is a stop.
_SHARES = 8
# Rounds over all corners; a third gains less than a thousandth.
_ROUNDS = 2
# Corners on either side whose speeds follow while the reach of a corner is looked for.
_NEIGHBOURS = 2


class Legs(NamedTuple):
    """Straight legs with limits along them.

    Args:
        lengths: Shape (m,) [rad or m].
        limits: Of speed (inf for none), acceleration and jerk along each, shape (m, 3).
    """

    lengths: Array
    limits: Array


class CornerLimits(NamedTuple):
    """Limits of constant speeds through corners that cubics of reach r round.

    Args:
        speed: Largest speed v whatever the reach, inf for none, shape (k,).
        acceleration: Largest v^2 / r, shape (k,).
        jerk: Largest v^3 / r^2, shape (k,).
    """

    speed: Array
    acceleration: Array
    jerk: Array


@kernel(allocates=False)
def ramp_time(change: float, acceleration: float, jerk: float) -> float:
    """Least time of a change of speed with no acceleration at its ends [s].

    Args:
        change: Of speed, at least 0.
        acceleration: Largest one.
        jerk: Largest one.
    """
    if change * jerk <= acceleration * acceleration:
        return 2.0 * math.sqrt(change / jerk)
    return change / acceleration + acceleration / jerk


@kernel(allocates=False)
def _ramp_length(low: float, high: float, acceleration: float, jerk: float) -> float:
    return 0.5 * (low + high) * ramp_time(high - low, acceleration, jerk)


@kernel(allocates=False)
def _ramp_slope(low: float, high: float, acceleration: float, jerk: float) -> float:
    """Derivative of a ramp's length by its higher speed; inf where both speeds are the same."""
    change = high - low
    rate = 1.0 / acceleration
    if change * jerk <= acceleration * acceleration:
        rate = 1.0 / math.sqrt(max(change * jerk, 1e-300))
    time = ramp_time(change, acceleration, jerk)
    return 0.5 * time + 0.5 * (low + high) * rate


@kernel(allocates=False)
def peak_speed(start: float, end: float, length: float, limits: Array, tolerance: float) -> float:
    """Largest speed of a leg that is begun and ended at given speeds; the larger if none is higher.

    Args:
        start: Speed at its start.
        end: Speed at its end.
        length: Of the leg.
        limits: Of speed, acceleration and jerk along it, shape (3,).
        tolerance: Error of the speed, as a part of it.
    """
    v, a, j = float(limits[0]), float(limits[1]), float(limits[2])
    low = max(start, end)
    ramps = _ramp_length(start, low, a, j) + _ramp_length(end, low, a, j)
    if ramps >= (1.0 - _SAME) * length:
        return low
    high = v
    if not high < np.inf:
        # From rest half the leg is run through in more time than this, at the least acceleration.
        high = low + math.sqrt(2.0 * a * length) + length * math.sqrt(a / length) + 1e-12
    if _ramp_length(start, high, a, j) + _ramp_length(end, high, a, j) <= length:
        return high
    below, above = low, high
    speed = 0.5 * (below + above)
    for _ in range(_MAX_STEPS):
        excess = _ramp_length(start, speed, a, j) + _ramp_length(end, speed, a, j) - length
        if excess > 0.0:
            above = speed
        else:
            below = speed
        slope = _ramp_slope(start, speed, a, j) + _ramp_slope(end, speed, a, j)
        better = speed - excess / slope
        if not below < better < above:
            better = 0.5 * (below + above)
        if abs(better - speed) <= tolerance * speed:
            return better
        speed = better
    return speed


@kernel(allocates=False)
def _reachable_speed(start: float, length: float, limits: Array, tolerance: float) -> float:
    """The largest speed that a leg allows at its end."""
    return peak_speed(start, start, 2.0 * length, limits, tolerance)


@kernel(allocates=False)
def leg_time(start: float, end: float, length: float, limits: Array, tolerance: float) -> float:
    """Least time of a leg between two speeds that it leaves room for [s]."""
    if length <= 0.0:
        return 0.0
    peak = peak_speed(start, end, length, limits, tolerance)
    a, j = limits[1], limits[2]
    ramps = _ramp_length(start, peak, a, j) + _ramp_length(end, peak, a, j)
    time = ramp_time(peak - start, a, j) + ramp_time(peak - end, a, j)
    return time + max(length - ramps, 0.0) / peak


@kernel(allocates=False)
def lower_speeds_kernel(legs: Legs, speeds: Array, tolerance: float) -> float:
    """Lower the speeds between legs to what they leave room for; the time of all legs [s].

    Args:
        legs: m legs.
        speeds: At the start, between the legs and at the end; the largest ones come in, the
            possible ones go out, shape (m + 1,).
        tolerance: Error of a speed, as a part of it.
    """
    m = legs.lengths.shape[0]
    for i in range(m):
        if speeds[i + 1] > speeds[i]:
            length, limits = legs.lengths[i], legs.limits[i]
            reachable = _reachable_speed(speeds[i], length, limits, tolerance)
            speeds[i + 1] = min(speeds[i + 1], reachable)
    for i in range(m - 1, -1, -1):
        if speeds[i] > speeds[i + 1]:
            length, limits = legs.lengths[i], legs.limits[i]
            reachable = _reachable_speed(speeds[i + 1], length, limits, tolerance)
            speeds[i] = min(speeds[i], reachable)
    time = 0.0
    for i in range(m):
        start, end = speeds[i], speeds[i + 1]
        time += leg_time(start, end, legs.lengths[i], legs.limits[i], tolerance)
    return time


@kernel
def _time_between(
    legs: Legs,
    corners: CornerLimits,
    reaches: Array,
    first: int,
    last: int,
    ends: tuple[float, float],
    speeds: Array,
) -> float:
    """Time of the legs from ``first`` to before ``last`` with the corners between them [s].

    Args:
        legs: All legs, not shortened by reaches.
        corners: Limits of the corners between them.
        reaches: Of all corners, shape (k,).
        first: Number of the first leg.
        last: Number of the leg after the last one.
        ends: Speeds before the first leg and after the last; the time is infinite where the legs
            do not leave room for them.
        speeds: The speeds at the ends of these legs are written here, shape (k + 2,).
    """
    k = reaches.shape[0]
    rest = np.empty(last - first)
    for i in range(first, last):
        rest[i - first] = legs.lengths[i]
        if i > 0:
            rest[i - first] -= reaches[i - 1]
        if i < k:
            rest[i - first] -= reaches[i]
    speeds[first], speeds[last] = ends
    time = 0.0
    for i in range(first, last - 1):
        r = reaches[i]
        bent = math.sqrt(corners.acceleration[i] * r)
        speeds[i + 1] = min(corners.speed[i], bent, (corners.jerk[i] * r * r) ** (1.0 / 3.0))
    part = speeds[first : last + 1]
    time += lower_speeds_kernel(Legs(rest, legs.limits[first:last]), part, _ROUGH)
    if speeds[first] < (1.0 - _ROUGH) * ends[0] or speeds[last] < (1.0 - _ROUGH) * ends[1]:
        return np.inf
    for i in range(first, last - 1):
        if reaches[i] > 0.0:
            if speeds[i + 1] <= 0.0:
                return np.inf
            time += 2.0 * reaches[i] / speeds[i + 1]
    return time


@kernel
def fastest_reaches_kernel(
    legs: Legs, corners: CornerLimits, largest: Array, reaches: Array
) -> None:
    """Write reaches of corners with which the motion is fastest, nearly.

    A wide curve is fast, but leaves less of its legs to speed up on. The same share of the largest
    reach is tried for all corners first, then others for each corner in turn while the speeds some
    corners away stay what they are.

    Args:
        legs: The whole legs, m = k + 1.
        corners: Limits of the corners between them.
        largest: Reaches at most, shape (k,).
        reaches: Shape (k,).
    """
    k = largest.shape[0]
    rest, speeds, trial, other = (0.0, 0.0), np.zeros(k + 2), np.empty(k), np.zeros(k + 2)
    # Windows about two corners have a speed in common up to this distance of the corners.
    settled, around = np.zeros(k, dtype=np.bool_), 2 * _NEIGHBOURS + 1
    best = np.inf
    for share in range(_SHARES + 1):
        for i in range(k):
            trial[i] = largest[i] * share / _SHARES
        time = _time_between(legs, corners, trial, 0, k + 1, rest, other)
        if time < best:
            best = time
            reaches[:], speeds[:] = trial, other
    for _ in range(_ROUNDS):
        for i in range(k):
            # Nothing that its time hangs on has changed since it was looked at.
            if settled[i]:
                continue
            settled[i] = True
            # Corner i lies between the legs i and i + 1.
            first, last = max(i - _NEIGHBOURS, 0), min(i + 2 + _NEIGHBOURS, k + 1)
            ends = (speeds[first], speeds[last])
            trial[:] = reaches
            # Beyond the ends curves go on at the same speeds: their reaches stay as they are.
            local = _time_between(legs, corners, trial, first, last, ends, other)
            known = reaches[i]
            for share in range(_SHARES + 1):
                trial[i] = largest[i] * share / _SHARES
                if trial[i] == known:
                    continue
                time = _time_between(legs, corners, trial, first, last, ends, other)
                if time < local:
                    local = time
                    reaches[i] = trial[i]
                    speeds[first : last + 1] = other[first : last + 1]
                    for j in range(max(i - around, 0), min(i + around + 1, k)):
                        settled[j] = j == i


@kernel(allocates=False)
def _write_ramp(
    place: float, start: float, end: float, limits: Array, least: float, phases: Array, used: int
) -> int:
    """Write the phases of a ramp from a place on, after ``used`` others; their number then."""
    change, a, j = abs(end - start), limits[1], limits[2]
    sign = 1.0 if end > start else -1.0
    if change <= _SAME * max(start, end):
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
        length: Of the leg.
        limits: Of speed, acceleration and jerk along it, shape (3,).
        phases: Room for ``MAX_PHASES`` rows of 5.
    """
    a, j = limits[1], limits[2]
    peak = peak_speed(start, end, length, limits, CONVERGED)
    least = _NO_TIME * leg_time(start, end, length, limits, CONVERGED)
    rising, falling = _ramp_length(start, peak, a, j), _ramp_length(end, peak, a, j)
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
        lengths: Of the path's pieces, shape (p,).
        straight: Which of them are straight, shape (p,).
        limits: Along the straight ones, shape (p, 3).
        speeds: At the start, between the pieces and at the end, shape (p + 1,).
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
