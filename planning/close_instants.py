"""Instants of a motion at which it is nearer to something than a checker allows."""

import math
from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array
from kinematics.compiled.kernel import direct, kernel
from kinematics.polynomial import sample_kernel
from obstacles.checker import Checker, any_model
from obstacles.lane_states import mark_blocked
from obstacles.model_arrays import ModelArrays

#: Looks at a motion are so far apart, Euclidean in joint space, for each metre of the distance that
#: is to be kept, and at least and at most. A link that goes straight past a corner at a distance of
#: 20 mm is 1 mm nearer there than 7 mm before.
_SPACING_PER_METRE = 1.0
_LEAST_SPACING = 0.01
_MOST_SPACING = 0.04
#: Looks at most.
_MAX_LOOKS = 1024
#: Instants by which the way of a motion is measured.
_INSTANTS = 32


def close_instants(level: Checker, breaks: Array, coefficients: Array, *, finely: int = 1) -> Array:
    """Instants of a motion at which it does not keep what a checker asks for, shape (k,) [s].

    Args:
        level: The robot in its scene, with the distances to be kept.
        breaks: Of the motion, shape (m + 1,) [s].
        coefficients: Of the motion, shape (m, n, k).
        finely: So many times as many instants as usual are looked at.
    """
    spacing = _SPACING_PER_METRE * level.model.margin
    spacing = min(max(spacing, _LEAST_SPACING), _MOST_SPACING) / finely
    times, arrays, slack = np.empty(_MAX_LOOKS + 1), level.model.arrays, float(level.slack)
    return times[: _find_close()(arrays, breaks, coefficients, spacing, slack, times)]


@cache
def _find_close() -> Callable[[ModelArrays, Array, Array, float, float, Array], int]:
    """``close_kernel`` without the look at its arguments' types."""
    one, three = np.zeros(1), np.zeros((1, 1, 1))
    return direct(close_kernel, any_model(), one, three, 0.0, 0.0, one)


@kernel
def close_kernel(
    model: ModelArrays, breaks: Array, coefficients: Array, spacing: float, slack: float,
    close: Array,
) -> int:  # fmt: skip
    """Write the instants of a motion, looked at after equal ways, that are not free; their number.

    Args:
        model: The packed robot and scene.
        breaks: Of the motion, shape (m + 1,) [s].
        coefficients: Of the motion, shape (m, n, k).
        spacing: Way between two of them, Euclidean in joint space [rad or m].
        slack: Distance to keep beyond the margins [m].
        close: Filled in order, with room for all that may be looked at [s].
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
    count = min(max(2, math.ceil(way[-1] / spacing)), close.shape[0] - 1)
    looked, at = np.empty(count + 1), 0
    for k in range(count + 1):
        gone = k * (way[-1] / count)
        while at < _INSTANTS - 1 and way[at + 1] < gone:
            at += 1
        left, span = gone - way[at], way[at + 1] - way[at]
        share = min(left / span, 1.0) if span > 0.0 else 0.0
        looked[k] = times[at] + share * (times[at + 1] - times[at])
    states, blocked = np.empty((count + 1, coefficients.shape[1])), np.empty(count + 1)
    look_kernel(model, breaks, coefficients, looked, slack, states, blocked)
    size = 0
    for k in range(count + 1):
        if blocked[k] != 0.0:
            close[size] = looked[k]
            size += 1
    return size


def instants(
    level: Checker, breaks: Array, coefficients: Array, times: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """States of a motion at some times, and which of them a checker does not allow.

    Args:
        level: The robot in its scene, with the distances to be kept.
        breaks: Of the motion, shape (m + 1,) [s].
        coefficients: Of the motion, shape (m, n, k).
        times: Shape (p,) [s].

    Returns:
        Shapes (p, n) [rad or m] and (p,).
    """
    states, blocked = np.empty((len(times), coefficients.shape[1])), np.empty(len(times))
    arrays, slack = level.model.arrays, float(level.slack)
    _look()(arrays, breaks, coefficients, times, slack, states, blocked)
    return states, blocked != 0.0


@cache
def _look() -> Callable[[ModelArrays, Array, Array, Array, float, Array, Array], None]:
    """``look_kernel`` without the look at its arguments' types."""
    one, two, three = np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1, 1))
    return direct(look_kernel, any_model(), one, three, one, 0.0, two, one)


@kernel
def look_kernel(
    model: ModelArrays, breaks: Array, coefficients: Array, times: Array, slack: float,
    states: Array, blocked: Array,
) -> None:  # fmt: skip
    """Write the states of a motion at some times, and which of them are not free.

    Args:
        model: The packed robot and scene.
        breaks: Of the motion, shape (m + 1,) [s].
        coefficients: Of the motion, shape (m, n, k).
        times: Shape (p,) [s].
        slack: Distance to keep beyond the margins [m].
        states: Filled, shape (p, n) [rad or m].
        blocked: Filled with 1 for those that are not free, 0 for the others, shape (p,).
    """
    sample_kernel(breaks, coefficients, times, 0, states)
    mark_blocked(model, states, slack, blocked)
