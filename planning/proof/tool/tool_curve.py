"""Deviations of a point and an orientation from lines and arcs, over an interval of motion."""

import math
from typing import NamedTuple

from compiled.kernel import kernel
from compiled.vec3 import Vector, cross, dot, scale, subtract
from kinematics.arrays import Array
from planning.proof.relative_motion import RelativeMotion

#: Angles that may change by more than this in an interval are not judged there [rad].
MAX_TURN = 0.5

# Entries of a motion as the kernels here read it; vectors by the first of three.
#: 0 for a line, 1 for an arc.
KIND = 0
#: Place at its start [m].
START = 1
#: Unit direction of a line, 0 where it has no length; of an arc towards its start.
ALONG = 4
#: Unit normal of an arc.
NORMAL = 7
#: Centre of an arc [m].
CENTER = 10
#: Axis that the orientation turns about, in the base's axes.
AXIS = 13
#: Length of a line or radius of an arc [m].
LENGTH = 16
#: Angle that an arc sweeps [rad].
SWEEP = 17
#: Angle that the orientation turns by [rad].
TURN = 18
#: Orientation at its start, row by row.
ROTATION = 19
WIDTH = 28


class Deviations(NamedTuple):
    """Deviations on one interval, position [m] and orientation [rad].

    Args:
        now: Deviation in the middle of the interval, shape (2,).
        upper: Bounds all over it, shape (2,).
        T: The tool's pose in its middle, shape (3, 4).
    """

    now: Array
    upper: Array
    T: Array


@kernel(allocates=False)
def vector_at(m: Array, first: int) -> Vector:
    """Three entries of a motion from ``first`` on."""
    return m[first], m[first + 1], m[first + 2]


@kernel
def _farthest(e: Vector, rate: Vector, half: float) -> float:
    """The larger one of |e + half rate| and |e - half rate|."""
    a, b = e, e
    for sign in (half, -half):
        b = (e[0] + sign * rate[0], e[1] + sign * rate[1], e[2] + sign * rate[2])
        a = b if dot(b, b) > dot(a, a) else a
    return math.sqrt(dot(a, a))


@kernel
def line_deviation(
    m: Array, p: Vector, spread: RelativeMotion, half: float, place: Array, found: Deviations
) -> tuple[bool, float, float, float]:
    """Position off a line; whether it is judged, and place, pace and change of pace along it."""
    now, upper, T = found
    u, length = vector_at(m, ALONG), m[LENGTH]
    y = subtract(p, vector_at(m, START))
    x, speed = dot(u, y), dot(u, spread.velocity)
    e, rate = subtract(y, scale(x, u)), subtract(spread.velocity, scale(speed, u))
    now[0] = math.sqrt(dot(e, e))
    upper[0] = _farthest(e, rate, half) + spread.bend
    if length > 0.0:
        travel = abs(speed) * half + spread.bend
        now[0] = math.hypot(now[0], max(0.0, -x, x - length))
        upper[0] = math.hypot(upper[0], max(0.0, travel - x, x + travel - length))
        return True, x / length, speed / length, spread.acceleration / length
    if m[TURN] == 0.0:
        return True, 0.0, 0.0, 0.0
    # A turn on the spot: the place that fits best, at the pace that does.
    if spread.turned > MAX_TURN:
        return False, 0.0, 0.0, 0.0
    angle = follow_angle(_turn_about(m, T), place)
    return True, angle / m[TURN], dot(vector_at(m, AXIS), spread.turn_rate) / m[TURN], 0.0


@kernel
def arc_deviation(
    m: Array, p: Vector, spread: RelativeMotion, half: float, place: Array, found: Deviations
) -> tuple[bool, float, float, float]:
    """Position off an arc; whether it is judged, and place, pace and change of pace along it."""
    now, upper, _ = found
    first, normal, radius, sweep = vector_at(m, ALONG), vector_at(m, NORMAL), m[LENGTH], m[SWEEP]
    second, v = cross(normal, first), spread.velocity
    y = subtract(p, vector_at(m, CENTER))
    a, b, z = dot(first, y), dot(second, y), dot(normal, y)
    va, vb, vz = dot(first, v), dot(second, v), dot(normal, v)
    distance = math.sqrt(a * a + b * b)
    fastest = math.sqrt(dot(v, v)) + spread.acceleration * half
    nearest = distance - min(fastest * half, spread.moved)
    if nearest <= 0.5 * distance:
        return False, 0.0, 0.0, 0.0
    across = (a * vb - b * va) / (distance * distance)
    faster = (spread.acceleration + 2.0 * fastest * fastest / nearest) / nearest
    travel = min(abs(across) * half + 0.5 * faster * half * half, spread.moved / nearest)
    if travel > MAX_TURN:
        return False, 0.0, 0.0, 0.0
    phi = follow_angle(math.atan2(b, a), place)
    now[0] = math.hypot(math.hypot(distance - radius, z), radius * max(0.0, -phi, phi - sweep))
    e, rate = (distance - radius, z, 0.0), ((a * va + b * vb) / distance, vz, 0.0)
    curved = 0.5 * (fastest * fastest / nearest) * half * half + spread.bend
    over = radius * max(0.0, travel - phi, phi + travel - sweep)
    upper[0] = math.hypot(_farthest(e, rate, half) + curved, over)
    return True, phi / sweep, across / sweep, faster / sweep


@kernel(allocates=False)
def follow_angle(angle: float, place: Array) -> float:
    """The angle with as many whole turns as bring it nearest to the one followed so far."""
    turns = math.floor((place[2] - angle) / (2.0 * math.pi) + 0.5)
    place[2] = angle + 2.0 * math.pi * turns
    return float(place[2])


@kernel
def _turn_about(m: Array, T: Array) -> float:
    """Angle about the motion's axis that T R_0^T contains, in (-pi, pi] [rad]."""
    R, sine, trace = m[ROTATION:].reshape(3, 3), 0.0, 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for c in range(3):
            trace += T[i, c] * R[i, c]
            sine += 0.5 * m[AXIS + i] * (T[k, c] * R[j, c] - T[j, c] * R[k, c])
    return math.atan2(sine, 0.5 * (trace - 1.0))


@kernel(allocates=False)
def angle_to_nominal(m: Array, s: float, T: Array) -> float:
    """Angle between the tool's orientation T and the motion's at place s [rad].

    With N = exp(s theta [a]) R_0, |N - T| = 2 sqrt(2) sin(angle / 2): exact where it is small.
    """
    c, v, a = math.cos(s * m[TURN]), math.sin(s * m[TURN]), vector_at(m, AXIS)
    square = 0.0
    for column in range(3):
        x = (m[ROTATION + column], m[ROTATION + 3 + column], m[ROTATION + 6 + column])
        turned, along = cross(a, x), dot(a, x) * (1.0 - c)
        for i in range(3):
            nominal = c * x[i] + v * turned[i] + along * a[i]
            square += (nominal - T[i, column]) ** 2
    return 2.0 * math.asin(min(1.0, math.sqrt(square / 8.0)))


@kernel(allocates=False)
def nominal_rotation(m: Array, s: float, N: Array) -> None:
    """Write the motion's orientation exp(s theta [a]) R_0 at place s into N (3, 3)."""
    c, v, a = math.cos(s * m[TURN]), math.sin(s * m[TURN]), vector_at(m, AXIS)
    for column in range(3):
        x = (m[ROTATION + column], m[ROTATION + 3 + column], m[ROTATION + 6 + column])
        turned, along = cross(a, x), dot(a, x) * (1.0 - c)
        for i in range(3):
            N[i, column] = c * x[i] + v * turned[i] + along * a[i]
