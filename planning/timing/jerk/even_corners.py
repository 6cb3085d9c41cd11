"""Rounded polylines timed with bounded jerk in few pieces, each corner at a speed of its own.

Reaches of the corners of a polyline with which it is run through fastest, nearly.

A wide curve is fast, but leaves less of its legs to speed up on. Eighths of the largest reach of a
corner are tried eight abreast (see ``compiled.simd``).
"""

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import direct, kernel
from compiled.simd import LANES, Lanes, anywhere, choose, fill, lane, load, store
from kinematics.arrays import Array, Indices
from kinematics.trajectory.polynomial import shift_kernel
from kinematics.trajectory.trajectory import Trajectory
from planning.timing.jerk.double_s import (
    CONVERGED,
    MAX_PHASES,
    Legs,
    leg_time,
    lower_speeds_kernel,
    polyline_phases_kernel,
    reachable_speed,
)
from planning.timing.path.blend import (
    kept_waypoints_kernel,
    largest_reaches_kernel,
    smooth_blend_kernel,
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


class Choices(NamedTuple):
    """Reaches of each corner that are tried, those from 0 to the largest, and those chosen.

    Args:
        reaches: Shape (k, 9).
        caps: Largest speeds through the corners, shape (k, 9).
        chosen: Numbers of reaches, shape (k,).
    """

    reaches: Array
    caps: Array
    chosen: Indices


class Trials(NamedTuple):
    """Eight motions in eight lanes.

    Args:
        reaches: Shape (k, 8).
        speeds: Speeds at the start, at the corners and at the end, shape (k + 2, 8).
        rest: Lengths of the legs between curves, shape (k + 1, 8).
        times: Shape (8,).
    """

    reaches: Array
    speeds: Array
    rest: Array
    times: Array


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
    k = largest.shape[0]
    choices = _choices(corners, largest)
    trials = Trials(
        np.empty((k, LANES)), np.empty((k + 2, LANES)), np.empty((k + 1, LANES)), np.empty(LANES)
    )
    speeds = np.zeros(k + 2)
    _choose_alike(legs, choices, trials, speeds)
    # Windows about two corners have a speed in common up to this distance of the corners.
    settled, around = np.zeros(k, dtype=np.bool_), 2 * _NEIGHBOURS + 1
    # Rounds over all corners; a third gains less than a thousandth.
    for _ in range(2):
        for i in range(k):
            # Nothing that its time hangs on has changed since it was checked.
            if settled[i]:
                continue
            settled[i] = True
            if largest[i] > 0.0 and _choose_one(legs, choices, trials, speeds, i):
                for j in range(max(i - around, 0), min(i + around + 1, k)):
                    settled[j] = j == i
    for i in range(k):
        reaches[i] = choices.reaches[i, choices.chosen[i]]


@kernel
def _choices(corners: CornerLimits, largest: Array) -> Choices:
    """Reaches that are tried, with the speeds that they allow."""
    k = largest.shape[0]
    reaches, caps = np.empty((k, _SHARES + 1)), np.empty((k, _SHARES + 1))
    for i in range(k):
        for share in range(_SHARES + 1):
            r = largest[i] * share / _SHARES
            bent, jerk = math.sqrt(corners.acceleration[i] * r), corners.jerk[i] * r * r
            reaches[i, share] = r
            caps[i, share] = min(corners.speed[i], bent, jerk ** (1.0 / 3.0))
    return Choices(reaches, caps, np.zeros(k, dtype=np.int64))


@kernel(allocates=False)
def _choose_alike(legs: Legs, choices: Choices, trials: Trials, speeds: Array) -> None:
    """Choose the same share of the largest reach for all corners, and write speeds (k + 2,)."""
    k = choices.chosen.shape[0]
    best, first = np.inf, 0
    while first <= _SHARES:
        # A stop at all corners stands alone, in all lanes.
        for i in range(k):
            for number in range(LANES):
                share = min(first + number, first * _SHARES)
                trials.reaches[i, number] = choices.reaches[i, share]
                trials.speeds[i + 1, number] = choices.caps[i, share]
        _time_between(legs, trials, 0, k + 1, 0.0, 0.0)
        for number in range(LANES):
            if trials.times[number] < best:
                best = trials.times[number]
                for i in range(k + 2):
                    speeds[i] = trials.speeds[i, number]
                for i in range(k):
                    choices.chosen[i] = min(first + number, first * _SHARES)
        first += 1 if first == 0 else LANES


@kernel(allocates=False)
def _choose_one(legs: Legs, choices: Choices, trials: Trials, speeds: Array, i: int) -> bool:
    """Choose the reach of corner i, which lies between the legs i and i + 1; whether it changed."""
    k, known = choices.chosen.shape[0], choices.chosen[i]
    first, last = max(i - _NEIGHBOURS, 0), min(i + 2 + _NEIGHBOURS, k + 1)
    # Beyond the ends curves go on at the same speeds: their reaches stay as they are.
    for j in range(max(first - 1, 0), min(last, k)):
        store(trials.reaches[j], 0, choices.reaches[j, choices.chosen[j]])
    best, chosen = np.inf, known
    for trial in range(2):
        for j in range(first, last - 1):
            store(trials.speeds[j + 1], 0, choices.caps[j, choices.chosen[j]])
        if trial == 1:
            for number in range(LANES):
                share = number if number < known else number + 1
                trials.reaches[i, number] = choices.reaches[i, share]
                trials.speeds[i + 1, number] = choices.caps[i, share]
        _time_between(legs, trials, first, last, speeds[first], speeds[last])
        for number in range(LANES if trial == 1 else 1):
            if trials.times[number] < best:
                best = trials.times[number]
                chosen = known
                if trial == 1:
                    chosen = number if number < known else number + 1
                    for j in range(first, last + 1):
                        speeds[j] = trials.speeds[j, number]
    choices.chosen[i] = chosen
    return bool(chosen != known)


@kernel(allocates=False)
def _time_between(
    legs: Legs, trials: Trials, first: int, last: int, begins: float, ends: float
) -> None:
    """Write times of the legs from ``first`` to before ``last`` with the corners between them [s].

    Args:
        legs: All legs, not shortened by reaches.
        trials: Reaches and largest speeds of the corners between come in; possible speeds and
            times go out. Times are infinite where legs do not leave room for their speeds.
        first: Number of the first leg.
        last: Number of the leg after the last one.
        begins: Speed before the first leg.
        ends: Speed after the last leg.
    """
    k = trials.reaches.shape[0]
    for i in range(first, last):
        rest = fill(legs.lengths[i])
        if i > 0:
            rest = rest - load(trials.reaches[i - 1], 0)
        if i < k:
            rest = rest - load(trials.reaches[i], 0)
        store(trials.rest[i], 0, rest)
    store(trials.speeds[first], 0, begins)
    store(trials.speeds[last], 0, ends)
    time = fill(0.0) + _lower_speeds(legs, trials, first, last)
    at_first, at_last = load(trials.speeds[first], 0), load(trials.speeds[last], 0)
    cramped = (at_first < (1.0 - _ROUGH) * begins) | (at_last < (1.0 - _ROUGH) * ends)
    for i in range(first, last - 1):
        reach, speed = load(trials.reaches[i], 0), load(trials.speeds[i + 1], 0)
        cramped = cramped | ((reach > 0.0) & (speed <= 0.0))
        time = choose(reach > 0.0, time + 2.0 * reach / speed, time)
    store(trials.times, 0, choose(cramped, np.inf, time))


@kernel(allocates=False)
def _lower_speeds(legs: Legs, trials: Trials, first: int, last: int) -> Lanes:
    """``lower_speeds_kernel`` of some legs in each lane."""
    speeds, rest = trials.speeds, trials.rest
    for i in range(first, last):
        before, after = load(speeds[i], 0), load(speeds[i + 1], 0)
        if anywhere(after > before):
            reachable = _reachable_speeds(before, load(rest[i], 0), legs.limits[i])
            store(speeds[i + 1], 0, choose(after > before, min(after, reachable), after))
    for i in range(last - 1, first - 1, -1):
        before, after = load(speeds[i], 0), load(speeds[i + 1], 0)
        if anywhere(before > after):
            reachable = _reachable_speeds(after, load(rest[i], 0), legs.limits[i])
            store(speeds[i], 0, choose(before > after, min(before, reachable), before))
    time = fill(0.0)
    for i in range(first, last):
        before, after = load(speeds[i], 0), load(speeds[i + 1], 0)
        time = time + _leg_times(before, after, load(rest[i], 0), legs.limits[i])
    return time


@kernel(allocates=False)
def _reachable_speeds(start: Lanes, length: Lanes, limits: Array) -> Lanes:
    """``reachable_speed`` in each lane, found once where all lanes are the same."""
    if _differ(start) or _differ(length):
        return reachable_speed(start, length, limits, _ROUGH)
    return fill(reachable_speed(lane(start, 0), lane(length, 0), limits, _ROUGH))


@kernel(allocates=False)
def _leg_times(start: Lanes, end: Lanes, length: Lanes, limits: Array) -> Lanes:
    """``leg_time`` in each lane, found once where all lanes are the same."""
    if _differ(start) or _differ(end) or _differ(length):
        return leg_time(start, end, length, limits, _ROUGH)
    return fill(leg_time(lane(start, 0), lane(end, 0), lane(length, 0), limits, _ROUGH))


@kernel(inline="code", allocates=False)
def _differ(value: Lanes) -> bool:
    """Whether not all lanes hold the same number."""
    first = lane(value, 0)
    return anywhere((value < first) | (value > first))


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
    _find_reaches()(np.ascontiguousarray(waypoints), limits, largest, reaches)
    return reaches


@cache
def _find_reaches() -> Callable[[Array, Array, Array, Array], None]:
    """``corner_reaches_kernel`` for contiguous arrays, without numba's check of their types."""
    return direct(corner_reaches_kernel, *np.zeros((2, 3, 1)), *np.zeros((2, 1)))


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
    """``pass_even_corners`` with all limits kept to the last bit.

    Returns:
        The motion, and the factor by which time was stretched for rounding.
    """
    motion = pass_even_corners(path, joint_names, limits)
    return dilate(motion, *limits)._replace(solver="double_s")


def pass_even_corners(path: JointPath, joint_names: Sequence[str], limits: Array) -> Trajectory:
    """The rounded polyline run through with bounded jerk, each corner at a constant speed.

    Legs take the least time between the speeds of their ends. The motion stops at sharp corners.
    The pieces are cubics of time with continuous acceleration.

    Args:
        path: Path of ``blend(..., smooth=True)``.
        joint_names: n names.
        limits: Limits of velocity (inf where there is none), acceleration and jerk, shape (3, n);
            rounding may exceed them.
    """
    return Trajectory(tuple(joint_names), *pieces_kernel(path.coefficients, path.lengths, limits))


@kernel
def rounded_pieces_kernel(waypoints: Array, reaches: Array, limits: Array) -> Pieces:
    """The pieces of ``pass_even_corners`` along ``blend`` of a merged polyline.

    Args:
        waypoints: Shape (k, n), k >= 2.
        reaches: Reaches of the corners, within their largest ones, shape (k - 2,).
        limits: Limits of velocity, acceleration and jerk, shape (3, n).
    """
    path, spans = smooth_blend_kernel(waypoints, reaches)
    return pieces_kernel(path, spans, limits)


@kernel
def pieces_kernel(coefficients: Array, lengths: Array, limits: Array) -> Pieces:
    """The pieces of ``pass_even_corners``.

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
