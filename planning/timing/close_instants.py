"""Instants of a motion at which it is nearer to something than a checker allows."""

import math
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import direct, kernel
from kinematics.arrays import Array, frozen
from kinematics.trajectory.polynomial import sample_kernel
from obstacles.collision.checker import Checker, any_model
from obstacles.collision.lanes.check import mark_blocked
from obstacles.collision.model.model_arrays import ModelArrays
from planning.values.limits import RATIO_TOLERANCE

# A spline may be nearer than preferred where the motion that it is near to is so at most this part
# of the duration away: their times differ a little.
_BESIDE = 0.02
# The same on both sides, and a little more.
_ABOUT = frozen(1.001 * np.array([-_BESIDE, _BESIDE]))
#: Instants by which the way of a motion is measured.
_INSTANTS = 32
#: All of any motion.
WHOLE = frozen(np.array([[-np.inf, np.inf]]))


def not_beside(places: Array, known: Array) -> Array:
    """Places among some (k,) that have none of those known (l,), in order, beside them."""
    if not len(known):
        return places
    after = np.minimum(np.searchsorted(known, places), len(known) - 1)
    before = np.maximum(after - 1, 0)
    beside = np.minimum(np.abs(known[after] - places), np.abs(known[before] - places))
    return np.asarray(places[beside > _BESIDE])


def spans_beside(places: Array) -> Array:
    """Spans outside which nothing lies beside some places (k,) in order, shape (k, 2)."""
    return places[:, None] + _ABOUT


def states_between(breaks: Array, coefficients: Array, count: int) -> Array:
    """States at instants evenly spaced between a motion's ends, shape (count, n)."""
    states = np.empty((count, coefficients.shape[1]))
    times = np.arange(1, count + 1) * (breaks[-1] / (count + 1))
    sample_kernel(breaks, coefficients, np.minimum(times, breaks[-1]), 0, states)
    return states


def outside_instants(
    breaks: Array, coefficients: Array, count: int, lower: Array, upper: Array
) -> Array:
    """Instants among those evenly spaced in a motion at which a joint is outside, shape (k,) [s].

    Args:
        breaks: Breaks of the motion, shape (m + 1,) [s].
        coefficients: Coefficients of the motion, shape (m, n, k).
        count: Instants to check.
        lower: Limits of the joints, shape (n,) [rad or m].
        upper: Upper limits, shape (n,).
    """
    states = states_between(breaks, coefficients, count)
    inside = (states >= lower - RATIO_TOLERANCE) & (states <= upper + RATIO_TOLERANCE)
    times = np.arange(1, count + 1) * (breaks[-1] / (count + 1))
    return np.asarray(times[~inside.all(axis=1)])


def is_inside(points: Array, lower: Array, upper: Array, spare: float) -> bool:
    """Whether points (k, n) are inside limits (n,) of the joints, and not near one [rad or m]."""
    return bool(((lower + spare < points) & (points < upper - spare)).all())


class CloseInstants(NamedTuple):
    """Instants of a motion at which it does not keep what a checker asks for, in order.

    Args:
        times: Shape (k,) [s].
        spans: Spans from the look before each of them to the one after it, shape (k, 2) [s].
    """

    times: Array
    spans: Array


def close_instants(
    level: Checker,
    breaks: Array,
    coefficients: Array,
    *,
    finely: int = 1,
    within: Array = WHOLE,
) -> CloseInstants:
    """Instants of a motion at which it does not keep what a checker asks for.

    Args:
        level: The robot in its scene, with the distances to be kept.
        breaks: Breaks of the motion, shape (m + 1,) [s].
        coefficients: Coefficients of the motion, shape (m, n, k).
        finely: Factor of the number of instants that are checked.
        within: Spans outside which no instant is checked, with their begins and their ends in
            order, shape (s, 2) [s].
    """
    # 1 rad for each metre of the distance that is to be kept: a link that goes straight past a
    # corner at a distance of 20 mm is 1 mm nearer there than 7 mm before.
    spacing = min(max(level.model.margin, 0.01), 0.04) / finely
    # Samples at most.
    looks, arrays, slack = np.empty((3, 1025)), level.model.arrays, float(level.slack)
    count = _find_close()(arrays, breaks, coefficients, spacing, slack, within, looks)
    return CloseInstants(looks[0, :count], np.ascontiguousarray(looks[1:, :count].T))


@cache
def _find_close() -> Callable[[ModelArrays, Array, Array, float, float, Array, Array], int]:
    """``close_kernel`` without a check of its arguments' types."""
    one, two, three = np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1, 1))
    return direct(close_kernel, any_model(), one, three, 0.0, 0.0, two, two)


@kernel
def close_kernel(
    model: ModelArrays, breaks: Array, coefficients: Array, spacing: float, slack: float,
    within: Array, close: Array,
) -> int:  # fmt: skip
    """Write the instants of a motion, checked after equal ways, that are not free; their number.

    Args:
        model: The packed robot and scene.
        breaks: Breaks of the motion, shape (m + 1,) [s].
        coefficients: Coefficients of the motion, shape (m, n, k).
        spacing: Way between two of them, Euclidean in joint space [rad or m].
        slack: Distance to keep beyond the margins [m].
        within: Spans of ``close_instants``.
        close: Filled in order with them and the instants before and after each, shape (3, p), with
            room for all that may be checked [s].
    """
    times, way = np.empty(_INSTANTS + 1), np.zeros(_INSTANTS + 1)
    for k in range(_INSTANTS + 1):
        times[k] = k * (breaks[-1] / _INSTANTS)
    states = np.empty((_INSTANTS + 1, coefficients.shape[1]))
    sample_kernel(breaks, coefficients, times, 0, states)
    for k in range(_INSTANTS):
        square = 0.0
        for j in range(states.shape[1]):
            square += (states[k + 1, j] - states[k, j]) ** 2
        way[k + 1] = way[k] + math.sqrt(square)
    count = min(max(2, math.ceil(way[-1] / spacing)), close.shape[1] - 1)
    every, numbers = np.empty(count + 1), np.empty(count + 1, np.int64)
    looked, size, at, span = np.empty(count + 1), 0, 0, 0
    for k in range(count + 1):
        gone = k * (way[-1] / count)
        while at < _INSTANTS - 1 and way[at + 1] < gone:
            at += 1
        left, length = gone - way[at], way[at + 1] - way[at]
        share = min(left / length, 1.0) if length > 0.0 else 0.0
        every[k] = times[at] + share * (times[at + 1] - times[at])
        while span < within.shape[0] and within[span, 1] < every[k]:
            span += 1
        if span < within.shape[0] and within[span, 0] <= every[k]:
            looked[size], numbers[size] = every[k], k
            size += 1
    states, blocked = np.empty((size, coefficients.shape[1])), np.empty(size)
    check_states_kernel(model, breaks, coefficients, looked[:size], slack, states, blocked)
    found = 0
    for i in range(size):
        if blocked[i] != 0.0:
            k = numbers[i]
            close[0, found] = every[k]
            close[1, found], close[2, found] = every[max(k - 1, 0)], every[min(k + 1, count)]
            found += 1
    return found


def instants(
    level: Checker, breaks: Array, coefficients: Array, times: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """States of a motion at some times, and which of them a checker does not allow.

    Args:
        level: The robot in its scene, with the distances to be kept.
        breaks: Breaks of the motion, shape (m + 1,) [s].
        coefficients: Coefficients of the motion, shape (m, n, k).
        times: Shape (p,) [s].

    Returns:
        Shapes (p, n) [rad or m] and (p,).
    """
    states, blocked = np.empty((len(times), coefficients.shape[1])), np.empty(len(times))
    arrays, slack = level.model.arrays, float(level.slack)
    _check_states()(arrays, breaks, coefficients, times, slack, states, blocked)
    return states, blocked != 0.0


@cache
def _check_states() -> Callable[[ModelArrays, Array, Array, Array, float, Array, Array], None]:
    """``check_states_kernel`` without a check of its arguments' types."""
    one, two, three = np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1, 1))
    return direct(check_states_kernel, any_model(), one, three, one, 0.0, two, one)


@kernel
def check_states_kernel(
    model: ModelArrays, breaks: Array, coefficients: Array, times: Array, slack: float,
    states: Array, blocked: Array,
) -> None:  # fmt: skip
    """Write the states of a motion at some times, and which of them are not free.

    Args:
        model: The packed robot and scene.
        breaks: Breaks of the motion, shape (m + 1,) [s].
        coefficients: Coefficients of the motion, shape (m, n, k).
        times: Shape (p,) [s].
        slack: Distance to keep beyond the margins [m].
        states: Filled, shape (p, n) [rad or m].
        blocked: Filled with 1 for those that are not free, 0 for the others, shape (p,).
    """
    sample_kernel(breaks, coefficients, times, 0, states)
    mark_blocked(model, states, slack, blocked, False)
