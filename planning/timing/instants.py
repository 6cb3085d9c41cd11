"""Instants of a motion: states at some, and those that have none of others beside them."""

from collections.abc import Callable
from functools import cache

import numpy as np

from compiled.kernel import direct, kernel
from kinematics.arrays import Array, frozen
from kinematics.trajectory.polynomial import sample_between_kernel
from planning.values.limits import RATIO_TOLERANCE

# A spline may be nearer than preferred where the motion that it is near to is so at most this part
# of the duration away: their times differ a little.
_BESIDE = 0.02
# The same on both sides, and a little more.
_ABOUT = frozen(1.001 * np.array([-_BESIDE, _BESIDE]))


def not_beside(places: Array, known: Array) -> Array:
    """Those of some places (k,) that have none of those known (l,), in order, beside them."""
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
    _sample_between()(breaks, coefficients, states)
    return states


def outside_instants(
    breaks: Array, coefficients: Array, count: int, lower: Array, upper: Array
) -> Array:
    """Those of instants evenly spaced in a motion at which a joint is outside, shape (k,) [s].

    Args:
        breaks: Of the motion, shape (m + 1,) [s].
        coefficients: Of the motion, shape (m, n, k).
        count: Instants to look at.
        lower: Limits of the joints, shape (n,) [rad or m].
        upper: Likewise.
    """
    states = states_between(breaks, coefficients, count)
    inside = (states >= lower - RATIO_TOLERANCE) & (states <= upper + RATIO_TOLERANCE)
    times = np.arange(1, count + 1) * (breaks[-1] / (count + 1))
    return np.asarray(times[~inside.all(axis=1)])


def is_inside(points: Array, lower: Array, upper: Array, spare: float) -> bool:
    """Whether points (k, n) are inside limits (n,) of the joints, and not near one [rad or m]."""
    return _is_inside()(points, lower, upper, spare)


@cache
def _is_inside() -> Callable[[Array, Array, Array, float], bool]:
    """``is_inside_kernel`` without numba's look at its arguments' types."""
    return direct(is_inside_kernel, np.zeros((1, 1)), frozen(np.zeros(1)), frozen(np.zeros(1)), 0.0)


@kernel(allocates=False, unlocks=False)
def is_inside_kernel(points: Array, lower: Array, upper: Array, spare: float) -> bool:
    """``is_inside``."""
    for i in range(points.shape[0]):
        for j in range(points.shape[1]):
            if not lower[j] + spare < points[i, j] < upper[j] - spare:
                return False
    return True


@cache
def _sample_between() -> Callable[[Array, Array, Array], None]:
    """``sample_between_kernel`` for a motion's arrays, without numba's look at their types."""
    return direct(sample_between_kernel, np.zeros(1), np.zeros((1, 1, 1)), np.zeros((1, 1)))
