"""An estimate of the time that a motion along a polyline takes, within microseconds.

A corner is passed at the speed that acceleration and jerk allow on a curve as wide as half of the
shorter leg beside it. Along the legs the motion speeds up and slows down at a share of the
acceleration limits; the rest of them stands for bounded jerk. On paths of plans of a Panda and a
UR5e the estimate goes with the time of the finished motion (correlation 0.96 and 0.98), which the
length of the path does far less (0.71 and 0.78).
"""

import math
from enum import IntEnum

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array


class Leg(IntEnum):
    """Row of ``legs``: SPEED and CORNER hold squares of the greatest speeds."""

    LENGTH = 0
    TIME = 1
    SPEED = 2
    ACCELERATION = 3
    CORNER = 4


LEG_ROWS = len(Leg)
#: Legs shorter than this count as no motion, turns smaller than this as none.
_STILL = 1e-9
#: Limits are at most this.
_MOST = 1e6


def estimate_limits(velocity: Array, acceleration: Array, jerk: Array | None) -> Array:
    """Limits for ``estimated_time``, shape (3, n); each (n,), None where jerk is not limited."""
    rows = velocity, acceleration, np.full_like(velocity, _MOST) if jerk is None else jerk
    return np.minimum(np.stack(rows), _MOST)


@kernel(allocates=False)
def estimated_time(points: Array, count: int, limits: Array, legs: Array) -> float:
    """Time of the motion along a polyline, at rest at its ends [s].

    Args:
        points: Waypoints, the first ``count`` of shape (c, n) [rad or m].
        count: Number of waypoints.
        limits: Limits of velocity, acceleration and jerk, shape (3, n).
        legs: Filled, leg by leg, shape (LEG_ROWS, c).
    """
    last = count - 1
    for k in range(last):
        _write_leg(points, k, limits, legs)
    legs[Leg.CORNER, 0] = legs[Leg.CORNER, last] = 0.0
    for k in range(1, last):
        fastest = _corner_speed(points, k, limits, legs)
        speed = (
            legs[Leg.CORNER, k - 1] + 2.0 * legs[Leg.ACCELERATION, k - 1] * legs[Leg.LENGTH, k - 1]
        )
        legs[Leg.CORNER, k] = min(fastest, speed)
    total = 0.0
    for k in range(last - 1, -1, -1):
        length, push = legs[Leg.LENGTH, k], legs[Leg.ACCELERATION, k]
        end = legs[Leg.CORNER, k + 1]
        begin = min(legs[Leg.CORNER, k], end + 2.0 * push * length)
        legs[Leg.CORNER, k] = begin
        peak = min(legs[Leg.SPEED, k], 0.5 * (begin + end) + push * length)
        speed = math.sqrt(peak)
        changes = (2.0 * speed - math.sqrt(begin) - math.sqrt(end)) / push
        even = max(length - (2.0 * peak - begin - end) / (2.0 * push), 0.0)
        legs[Leg.TIME, k] = changes + (even / speed if speed > 0.0 else 0.0)
        total += legs[Leg.TIME, k]
    return total


@kernel(allocates=False)
def _write_leg(points: Array, k: int, limits: Array, legs: Array) -> None:
    """Write length, greatest speed and acceleration of leg k."""
    square = 0.0
    for j in range(points.shape[1]):
        square += (points[k + 1, j] - points[k, j]) ** 2
    length = math.sqrt(square)
    speed, push = _MOST, _MOST
    for j in range(points.shape[1]):
        share = abs(points[k + 1, j] - points[k, j]) / max(length, _STILL)
        if share > _STILL:
            speed, push = min(speed, limits[0, j] / share), min(push, limits[1, j] / share)
    # Share of the acceleration limit that speeds are changed with.
    legs[Leg.LENGTH, k], legs[Leg.SPEED, k], legs[Leg.ACCELERATION, k] = (
        length,
        speed * speed,
        0.7 * push,
    )


@kernel(allocates=False)
def _corner_speed(points: Array, k: int, limits: Array, legs: Array) -> float:
    """Square of the speed at which the corner at waypoint k can be passed."""
    before, after = max(legs[Leg.LENGTH, k - 1], _STILL), max(legs[Leg.LENGTH, k], _STILL)
    bend, jolt = _MOST, _MOST
    for j in range(points.shape[1]):
        turn = abs(
            (points[k + 1, j] - points[k, j]) / after - (points[k, j] - points[k - 1, j]) / before
        )
        if turn > _STILL:
            bend, jolt = min(bend, limits[1, j] / turn), min(jolt, limits[2, j] / turn)
    # Share of the shorter leg that a corner is rounded over.
    reach = 0.5 * min(before, after)
    square = min(bend * reach, (jolt * reach * reach) ** (2.0 / 3.0))
    return float(min(square, legs[Leg.SPEED, k - 1], legs[Leg.SPEED, k]))
