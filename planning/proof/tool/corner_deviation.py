"""Deviation of a point and an orientation from a rounded corner, over an interval of motion.

A corner superposes the end of one motion and the beginning of the next: with the place
h(u) = a (u - 6 u^3 + 8 u^4 - 3 u^5) + 10 u^3 - 15 u^4 + 6 u^5 on the first leg and
g(u) = 1 - h(1 - u) on the second one,

    c(u) = p_1(h) + p_2(g) - p_corner,    N(u) = exp(g b) exp(h a) R_0,

a and b the rotation vectors of both legs. In the middle of the interval u is nearest to the tool;
over it u may run as one likes, since each u(t) gives a bound: at the constant pace w that keeps up
with the tool. Then p - c(u) has a second derivative of at most that of p and w^2 max |c''|, and the
angle to N(u) changes by the relative angular velocity, which changes likewise. Beyond its ends the
curve goes straight on, and N turns on, at the rates that they have there; what the place runs
beyond them counts.
"""

import math

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import Vector, cross, dot, scale, subtract
from kinematics.arrays import Array
from planning.proof.relative_motion import RelativeMotion
from planning.proof.tool.tool_curve import (
    ALONG,
    AXIS,
    CENTER,
    KIND,
    LENGTH,
    NORMAL,
    ROTATION,
    START,
    SWEEP,
    TURN,
    WIDTH,
    Deviations,
    vector_at,
)

# Entries of a corner after those of its first leg, whose kind is 2.
#: The second leg.
SECOND = WIDTH
#: Kind of the first leg.
FIRST_KIND = 2 * WIDTH
#: Slope a of h at 0.
SLOPE = 2 * WIDTH + 1
#: Bounds of |c'| and |c''| [m].
RATE = 2 * WIDTH + 2
BEND = 2 * WIDTH + 3
#: Bounds of the angular velocity by u and of its derivative [rad].
TURN_RATE = 2 * WIDTH + 4
TURN_BEND = 2 * WIDTH + 5
CORNER_WIDTH = 2 * WIDTH + 6
#: Looks at a corner for its part nearest to the tool.
_LOOKS = 24
#: Steps towards the nearest place from there.
_STEPS = 10


def pack_corner(first: Array, second: Array, slope: float) -> Array:
    """A corner as the kernels read it, shape (CORNER_WIDTH,).

    Args:
        first: First leg of the corner, shape (WIDTH,).
        second: Second leg of the corner, shape (WIDTH,).
        slope: Slope a.
    """
    m = np.concatenate([first, second, np.zeros(6)])
    m[FIRST_KIND], m[KIND], m[SLOPE] = first[KIND], 2.0, slope
    # h is a Bezier curve through 0, a/5, 2a/5, 1, 1, 1: the differences of its points bound it.
    points = np.array([0.0, slope / 5.0, 2.0 * slope / 5.0, 1.0, 1.0, 1.0])
    rate = 5.0 * float(np.abs(np.diff(points)).max())
    bend = 20.0 * float(np.abs(np.diff(points, 2)).max())
    for leg in (first, second):
        is_arc = leg[KIND] != 0.0
        length = leg[LENGTH] * (leg[SWEEP] if is_arc else 1.0)
        m[RATE] += rate * length
        m[BEND] += bend * length + (rate * rate * length * leg[SWEEP] if is_arc else 0.0)
        m[TURN_RATE] += rate * leg[TURN]
        m[TURN_BEND] += bend * leg[TURN]
    m[TURN_BEND] += rate * rate * first[TURN] * second[TURN]
    return m


@kernel
def corner_deviation(
    m: Array, p: Vector, spread: RelativeMotion, half: float, found: Deviations
) -> None:
    """Write deviations from a corner in the middle of an interval, and bounds all over it.

    Args:
        m: The corner, shape (CORNER_WIDTH,).
        p: Place of the tool [m].
        spread: Motion of the tool over the interval.
        half: Half the interval's length.
        found: Place whose ``T`` is the tool's pose.
    """
    now, upper, T = found
    u = _nearest_parameter(m, p)
    c, rate = _curve(m, u)
    square = dot(rate, rate)
    pace = dot(spread.velocity, rate) / square if square > 0.0 else 0.0
    beyond = max(0.0, abs(pace) * half - u, u + abs(pace) * half - 1.0)
    e, change = subtract(p, c), subtract(spread.velocity, scale(pace, rate))
    plus, minus = subtract(e, scale(-half, change)), subtract(e, scale(half, change))
    now[0] = math.sqrt(dot(e, e))
    upper[0] = math.sqrt(max(dot(plus, plus), dot(minus, minus))) + spread.bend
    upper[0] += 0.5 * pace * pace * m[BEND] * half * half + beyond * m[RATE]
    square, turn = _nominal(m, u, T)
    now[1] = 2.0 * math.asin(min(1.0, math.sqrt(square / 8.0)))
    relative = subtract(spread.turn_rate, scale(pace, turn))
    upper[1] = now[1] + math.sqrt(dot(relative, relative)) * half + spread.turn_bend
    upper[1] += 0.5 * pace * pace * m[TURN_BEND] * half * half + beyond * m[TURN_RATE]


@kernel(allocates=False)
def _leg_place(a: float, u: float) -> tuple[float, float]:
    """H and dh/du."""
    w = 1.0 - u
    # As a Bezier curve: 1 less the parts of the points that are not 1 yet.
    h = 1.0 - w**3 * (w * w + (5.0 - a) * w * u + (10.0 - 4.0 * a) * u * u)
    rate = w * w * (a * w * w + 4.0 * a * w * u + (30.0 - 12.0 * a) * u * u)
    return h, rate


@kernel(allocates=False)
def _turned(v: Vector, axis: Vector, angle: float) -> Vector:
    """A vector turned about a unit axis."""
    c, s = math.cos(angle), math.sin(angle)
    side, along = cross(axis, v), dot(axis, v) * (1.0 - c)
    return (
        c * v[0] + s * side[0] + along * axis[0],
        c * v[1] + s * side[1] + along * axis[1],
        c * v[2] + s * side[2] + along * axis[2],
    )


@kernel(allocates=False)
def _leg(m: Array, first: int, kind: float, s: float) -> tuple[Vector, Vector]:
    """Place and its derivative at place s of the leg whose entries begin at ``first``."""
    along, start = vector_at(m, first + ALONG), vector_at(m, first + START)
    length = m[first + LENGTH]
    if kind == 0.0:
        way = scale(length, along)
        return (start[0] + s * way[0], start[1] + s * way[1], start[2] + s * way[2]), way
    center, normal = vector_at(m, first + CENTER), vector_at(m, first + NORMAL)
    spoke = _turned(scale(length, along), normal, s * m[first + SWEEP])
    place = (center[0] + spoke[0], center[1] + spoke[1], center[2] + spoke[2])
    return place, scale(m[first + SWEEP], cross(normal, spoke))


@kernel(allocates=False)
def _curve(m: Array, u: float) -> tuple[Vector, Vector]:
    """Place c and dc/du."""
    h, h_rate = _leg_place(m[SLOPE], u)
    back, g_rate = _leg_place(m[SLOPE], 1.0 - u)
    one, one_way = _leg(m, 0, m[FIRST_KIND], h)
    other, other_way = _leg(m, SECOND, m[SECOND + KIND], 1.0 - back)
    corner = vector_at(m, SECOND + START)
    c = (
        one[0] + other[0] - corner[0],
        one[1] + other[1] - corner[1],
        one[2] + other[2] - corner[2],
    )
    rate = (
        h_rate * one_way[0] + g_rate * other_way[0],
        h_rate * one_way[1] + g_rate * other_way[1],
        h_rate * one_way[2] + g_rate * other_way[2],
    )
    return c, rate


@kernel(allocates=False)
def _nearest_parameter(m: Array, p: Vector) -> float:
    """The u at which the corner is nearest to a place."""
    best, u = np.inf, 0.0
    for i in range(_LOOKS + 1):
        e = subtract(p, _curve(m, i / _LOOKS)[0])
        if dot(e, e) < best:
            best, u = dot(e, e), i / _LOOKS
    for _ in range(_STEPS):
        c, rate = _curve(m, u)
        square = dot(rate, rate)
        if square > 0.0:
            u = min(1.0, max(0.0, u + dot(subtract(p, c), rate) / square))
    return u


@kernel
def _nominal(m: Array, u: float, T: Array) -> tuple[float, Vector]:
    """Square of |N(u) - T|, and the angular velocity of N by u."""
    h, h_rate = _leg_place(m[SLOPE], u)
    back, g_rate = _leg_place(m[SLOPE], 1.0 - u)
    a, b = vector_at(m, AXIS), vector_at(m, SECOND + AXIS)
    first, second = h * m[TURN], (1.0 - back) * m[SECOND + TURN]
    square = 0.0
    for column in range(3):
        x = (m[ROTATION + column], m[ROTATION + 3 + column], m[ROTATION + 6 + column])
        nominal = _turned(_turned(x, a, first), b, second)
        for i in range(3):
            square += (nominal[i] - T[i, column]) ** 2
    moved, own = _turned(a, b, second), g_rate * m[SECOND + TURN]
    other = h_rate * m[TURN]
    turn = (
        own * b[0] + other * moved[0],
        own * b[1] + other * moved[1],
        own * b[2] + other * moved[2],
    )
    return square, turn
