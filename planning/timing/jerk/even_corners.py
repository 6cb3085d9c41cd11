"""Rounded polylines timed with bounded jerk in few pieces, each corner at a speed of its own.

Reaches of the corners of a polyline with which it is run through fastest, nearly.

A wide curve is fast, but leaves less of its legs to speed up on. Eighths of the largest reach of a
corner are tried.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import directly, kernel
from kinematics.arrays import Array
from kinematics.trajectory.polynomial import shift_kernel
from kinematics.trajectory.trajectory import Trajectory
from planning.timing.jerk.double_s import (
    CONVERGED,
    MAX_PHASES,
    Legs,
    lower_speeds_kernel,
    polyline_phases_kernel,
)
from planning.timing.path.blend import (
    kept_waypoints_kernel,
    largest_reaches_kernel,
)
from planning.timing.path.path import JointPath, compose_kernel
from planning.timing.time_scaling import ScaledTime, dilate

# Error of a speed while reaches are compared, as a part of it.
_ROUGH = 1e-4
# Shares of the largest reach of a corner that are tried; 0 is a stop.
_SHARES = 8
# Corners on either side whose speeds follow while the reach of a corner is searched for.
_NEIGHBOURS = 2


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


@kernel
def fastest_reaches_kernel(
    legs: Legs, corners: CornerLimits, largest: Array, reaches: Array
) -> None:
    """Write reaches of corners with which the motion is fastest, nearly.

    The same share of the largest reach is tried for all corners first, then others for each corner
    in turn while the speeds some corners away stay what they are.

    Args:
        legs: The whole legs, m = k + 1.
        corners: Limits of the corners between them.
        largest: Reaches at most, shape (k,).
        reaches: Shape (k,).
    """
    k, best = largest.shape[0], np.inf
    trial, speeds, rest, known = np.empty(k), np.zeros(k + 2), np.empty(k + 1), np.zeros(k + 2)
    for share in range(_SHARES + 1):
        for i in range(k):
            trial[i] = largest[i] * share / _SHARES
        time = _time_between(legs, corners, trial, speeds, rest, (0, k + 1))
        if time < best:
            best = time
            reaches[:], known[:] = trial, speeds
    # Rounds over all corners; a third gains less than a thousandth.
    for _ in range(2):
        for i in range(k):
            if largest[i] > 0.0:
                _choose_reach(legs, corners, largest[i], reaches, (known, speeds, rest), i)


@kernel(allocates=False)
def _choose_reach(
    legs: Legs, corners: CornerLimits, largest: float, reaches: Array,
    work: tuple[Array, Array, Array], i: int,
) -> None:  # fmt: skip
    """Choose the reach of corner i, which lies between the legs i and i + 1.

    Args:
        legs: The whole legs.
        corners: Limits of the corners.
        largest: Its reach at most.
        reaches: Reaches of all corners, changed.
        work: Speeds with the reaches as they are (k + 2,), changed, and room for others and for the
            lengths of the legs between curves.
        i: Number of the corner.
    """
    k, (known, speeds, rest) = reaches.shape[0], work
    window = max(i - _NEIGHBOURS, 0), min(i + 2 + _NEIGHBOURS, k + 1)
    best, chosen = np.inf, reaches[i]
    for share in range(-1, _SHARES + 1):
        # As it is comes first, and stays where no other one is faster.
        reaches[i] = chosen if share < 0 else largest * share / _SHARES
        speeds[window[0]], speeds[window[1]] = known[window[0]], known[window[1]]
        time = _time_between(legs, corners, reaches, speeds, rest, window)
        if time < best:
            best, chosen = time, reaches[i]
    reaches[i] = chosen
    speeds[window[0]], speeds[window[1]] = known[window[0]], known[window[1]]
    _time_between(legs, corners, reaches, speeds, rest, window)
    for j in range(window[0], window[1] + 1):
        known[j] = speeds[j]


@kernel(allocates=False)
def _time_between(
    legs: Legs, corners: CornerLimits, reaches: Array, speeds: Array, rest: Array,
    window: tuple[int, int],
) -> float:  # fmt: skip
    """Time of some legs with the corners between them; inf where there is no room for speeds [s].

    Args:
        legs: All legs, not shortened by reaches.
        corners: Limits of the corners.
        reaches: Reaches of the corners, shape (k,).
        speeds: Speeds before the first leg and after the last one come in, those at the corners
            between go out, shape (k + 2,).
        rest: Filled with lengths of the legs between curves, shape (k + 1,).
        window: Numbers of the first leg and of the leg after the last one.
    """
    (first, last), k = window, reaches.shape[0]
    for i in range(first, last):
        before, after = reaches[i - 1] if i > 0 else 0.0, reaches[i] if i < k else 0.0
        rest[i] = legs.lengths[i] - before - after
    for i in range(first, last - 1):
        bent = math.sqrt(corners.acceleration[i] * reaches[i])
        jerk = corners.jerk[i] * reaches[i] * reaches[i]
        speeds[i + 1] = min(corners.speed[i], bent, jerk ** (1.0 / 3.0))
    begins, ends = speeds[first], speeds[last]
    shortened = Legs(rest[first:last], legs.limits[first:last])
    time = lower_speeds_kernel(shortened, speeds[first : last + 1], _ROUGH)
    if speeds[first] < (1.0 - _ROUGH) * begins or speeds[last] < (1.0 - _ROUGH) * ends:
        return np.inf
    for i in range(first, last - 1):
        if reaches[i] > 0.0:
            if speeds[i + 1] <= 0.0:
                return np.inf
            time += 2.0 * reaches[i] / speeds[i + 1]
    return time


class Pieces(NamedTuple):
    """Cubic pieces of a motion, not yet checked.

    Args:
        breaks: Shape (m + 1,) [s].
        coefficients: Shape (m, n, 4).
    """

    breaks: Array
    coefficients: Array


def fastest_reaches(waypoints: Array, limits: Array, largest: Array) -> Array:
    """Reaches of a polyline's corners with which ``time_even_corners`` is fastest, nearly.

    Args:
        waypoints: Merged, shape (k, n), k >= 3.
        limits: Limits of velocity, acceleration and jerk, shape (3, n).
        largest: Reaches at most, shape (k - 2,).

    Returns:
        Reaches for ``blend``, shape (k - 2,).
    """
    reaches = np.zeros(len(largest))
    directly(corner_reaches_kernel, np.ascontiguousarray(waypoints), limits, largest, reaches)
    return reaches


@kernel
def corner_reaches_kernel(waypoints: Array, limits: Array, largest: Array, reaches: Array) -> None:
    """``fastest_reaches_kernel`` of the polyline through waypoints (k, n)."""
    legs, n = waypoints.shape[0] - 1, waypoints.shape[1]
    lengths, directions = np.zeros(legs), np.empty((legs, n))
    along = np.full((legs, 3), np.inf)
    at_corners = np.full((3, legs - 1), np.inf)
    for i in range(legs):
        for joint in range(n):
            directions[i, joint] = waypoints[i + 1, joint] - waypoints[i, joint]
            lengths[i] += directions[i, joint] ** 2
        lengths[i] = math.sqrt(lengths[i])
        for joint in range(n):
            directions[i, joint] /= lengths[i]
            for row in range(3):
                along[i, row] = min(along[i, row], limits[row, joint] / abs(directions[i, joint]))
    for i in range(legs - 1):
        for joint in range(n):
            before, after = directions[i, joint], directions[i + 1, joint]
            steepest, turn = max(abs(before), abs(after)), abs(after - before)
            for row in range(3):
                limit = limits[row, joint] / (steepest if row == 0 else turn)
                at_corners[row, i] = min(at_corners[row, i], limit)
    corners = CornerLimits(at_corners[0], at_corners[1], at_corners[2])
    kept, widest = np.empty(legs + 1, dtype=np.int64), np.zeros(legs - 1)
    largest_reaches_kernel(waypoints, kept[: kept_waypoints_kernel(waypoints, kept)], widest)
    for i in range(legs - 1):
        widest[i] = min(widest[i], largest[i])
    fastest_reaches_kernel(Legs(lengths, along), corners, widest, reaches)


def time_even_corners(path: JointPath, joint_names: Sequence[str], limits: Array) -> ScaledTime:
    """The rounded polyline run through with bounded jerk, each corner at a constant speed.

    Legs take the least time between the speeds of their ends. The motion stops at sharp corners.
    The pieces are cubics of time with continuous acceleration.

    Args:
        path: Path of ``blend(..., smooth=True)``.
        joint_names: n names.
        limits: Limits of velocity (inf where there is none), acceleration and jerk, shape (3, n).

    Returns:
        The motion, and the factor by which time was stretched for rounding.
    """
    pieces = pieces_kernel(path.coefficients, path.lengths, limits)
    motion = Trajectory(tuple(joint_names), *pieces)
    return dilate(motion, *limits)._replace(solver="double_s")


@kernel
def pieces_kernel(coefficients: Array, lengths: Array, limits: Array) -> Pieces:
    """The pieces of ``time_even_corners``; rounding may exceed the limits.

    Args:
        coefficients: Coefficients of the path, cubics, shape (p, n, 4).
        lengths: Lengths of the pieces, shape (p,).
        limits: Limits of velocity, acceleration and jerk, shape (3, n).
    """
    count, n = coefficients.shape[:2]
    straight, along = np.empty(count, dtype=np.bool_), np.empty((count, 3))
    speeds = np.zeros(count + 1)
    path_speeds_kernel(coefficients, lengths, limits, straight, along, speeds)
    phases, owners = np.empty((MAX_PHASES * count, 5)), np.empty(MAX_PHASES * count, dtype=np.int64)
    used = polyline_phases_kernel(lengths, straight, along, speeds, phases, owners)
    # Degree of q(t): straight pieces in phases of constant jerk, cubics at constant speed.
    degree = 3
    breaks, pieces = np.zeros(used + 1), np.empty((used, n, degree + 1))
    shifted, product, inner = np.empty(4), np.empty(10), np.empty(3)
    whole, made = np.zeros(10), 0
    for i in range(used):
        owner, start = owners[i], phases[i, 0]
        inner[0], inner[1], inner[2] = phases[i, 1], phases[i, 2], phases[i, 3]
        breaks[made + 1] = breaks[made] + phases[i, 4]
        # A phase that is shorter than the rounding of its time is none.
        if not breaks[made + 1] > breaks[made]:
            continue
        made += 1
        for joint in range(n):
            c, out = coefficients[owner, joint], pieces[made - 1, joint]
            if straight[owner]:
                out[0] = c[0] + start * c[1]
                for k in range(degree):
                    # Not minus 0.
                    out[k + 1] = 0.0 + c[1] * inner[k]
                continue
            # At constant speed a curve stays a cubic.
            shift_kernel(c, start, shifted)
            top = degree
            while top > 0 and shifted[top] == 0.0:
                top -= 1
            whole[:] = 0.0
            compose_kernel(shifted, top, inner, product, whole)
            for k in range(degree + 1):
                out[k] = whole[k]
    return Pieces(breaks[: made + 1], pieces[:made])


@kernel
def path_speeds_kernel(
    coefficients: Array,
    lengths: Array,
    limits: Array,
    straight: NDArray[np.bool_],
    along: Array,
    speeds: Array,
) -> None:
    """Write the speeds at the ends of the pieces of a path that begins and ends at rest.

    Args:
        coefficients: Coefficients of the path, cubics, shape (p, n, 4).
        lengths: Lengths of the pieces, shape (p,).
        limits: Limits of velocity, acceleration and jerk, shape (3, n).
        straight: Filled: which pieces are straight, shape (p,).
        along: Filled with the limits along the straight ones, shape (p, 3).
        speeds: Filled, shape (p + 1,).
    """
    count, n = coefficients.shape[:2]
    legs = 0
    for i in range(count):
        straight[i] = True
        for row in range(3):
            along[i, row] = np.inf
        for joint in range(n):
            c = coefficients[i, joint]
            straight[i] &= c[2] == 0.0 and c[3] == 0.0
            for row in range(3):
                along[i, row] = min(along[i, row], limits[row, joint] / abs(c[1]))
        legs += straight[i]
    # Curves that meet share a speed: each piece that is straight begins a leg after such a run.
    caps, leg_lengths, leg_limits = np.zeros(legs + 1), np.empty(legs), np.empty((legs, 3))
    run = 0
    for i in range(count):
        if straight[i]:
            leg_lengths[run] = lengths[i]
            for row in range(3):
                leg_limits[run, row] = along[i, row]
            run += 1
        elif 0 < run < legs:
            speed = _curve_speed(coefficients[i], lengths[i], limits)
            caps[run] = speed if caps[run] == 0.0 else min(caps[run], speed)
    lower_speeds_kernel(Legs(leg_lengths, leg_limits), caps, CONVERGED)
    run, speeds[0] = 0, 0.0
    for i in range(count):
        run += straight[i]
        speeds[i + 1] = caps[run]


@kernel(allocates=False)
def _curve_speed(c: Array, length: float, limits: Array) -> float:
    """Largest constant speed through a cubic piece (n, 4) of a rounded corner."""
    by_speed, by_bend, by_jerk = np.inf, np.inf, np.inf
    for joint in range(c.shape[0]):
        bend, jerk = 2.0 * c[joint, 2], 6.0 * c[joint, 3]
        begins = c[joint, 1]
        ends = begins + (bend + 0.5 * jerk * length) * length
        by_speed = min(by_speed, limits[0, joint] / max(abs(begins), abs(ends)))
        bend = max(abs(bend), abs(bend + jerk * length))
        by_bend = min(by_bend, limits[1, joint] / bend)
        by_jerk = min(by_jerk, limits[2, joint] / abs(jerk))
    return float(min(by_speed, math.sqrt(by_bend), by_jerk ** (1.0 / 3.0)))
