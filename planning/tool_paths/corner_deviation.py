"""Deviation of the tool from a rounded corner over a cell of time, for planners.

Of the parameter u of the corner's curve c the one nearest to the tool is found in the middle of the
cell, and taken to run at a constant pace u' = v c' / |c'|^2. With it e = p - c(u) changes at
v - u' c', its second derivative is at most P + u'^2 max |c''|, and the angle to the nominal
orientation N(u) changes at most by the relative angular velocity. Any pace gives a bound; this one
a sharp one. Beyond its ends the curve counts as going straight on, and what the tool overshoots is
added.
"""

import math
from enum import IntEnum

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array
from planning.tool_motions.tool_corner import (
    BEND,
    CORNER_ROTATION,
    FIRST_LEG,
    RATE,
    SECOND_LEG,
    SLOPE,
    TURN_BEND,
    TURN_RATE,
)
from planning.tool_motions.tool_motion import (
    ALONG,
    AXIS,
    CENTER,
    KIND,
    LENGTH,
    LINE,
    ROTATION,
    SIDE,
    SIZE,
    START,
    SWEEP,
    TURN,
)


class Cell(IntEnum):
    """Entry of a cell's state."""

    #: Deviation of the position in the cell's middle [m].
    POSITION = 0
    #: Deviation of the orientation in the cell's middle [rad].
    ORIENTATION = 1
    #: Bound of the position's deviation all over the cell [m].
    POSITION_BOUND = 2
    #: Bound of the orientation's deviation all over the cell [rad].
    ORIENTATION_BOUND = 3
    #: Bound of the tool's acceleration [m/s^2].
    ACCELERATION = 4
    #: Bound of the tool's angular acceleration [rad/s^2].
    ANGULAR = 5
    #: Angle in the middle of the last cell, which tells this one's whole turns [rad].
    ANGLE = 6
    #: Place on the motion, from 0 to 1.
    PLACE = 7
    #: Rate of the place [1/s].
    PACE = 8
    #: Bound of the rate's change [1/s^2].
    PACE_CHANGE = 9


CELL_SIZE = 10


@kernel(allocates=False)
def norm(a: float, b: float, c: float) -> float:
    """Length of (a, b, c)."""
    return math.sqrt(a * a + b * b + c * c)


@kernel
def farthest(e: Array, rate: Array, h: float) -> float:
    """The larger of |e + h e'| and |e - h e'|."""
    plus, minus = 0.0, 0.0
    for k in range(3):
        plus += (e[k] + h * rate[k]) ** 2
        minus += (e[k] - h * rate[k]) ** 2
    return math.sqrt(max(plus, minus))


@kernel(allocates=False)
def nominal_kernel(m: Array, s: float, R: Array) -> None:
    """Write exp(s theta [a]) R_0 of a motion's numbers into R (3, 3)."""
    angle = s * m[TURN]
    c, v = math.cos(angle), math.sin(angle)
    for column in range(3):
        x, y, z = m[ROTATION + column], m[ROTATION + 3 + column], m[ROTATION + 6 + column]
        along = (m[AXIS] * x + m[AXIS + 1] * y + m[AXIS + 2] * z) * (1.0 - c)
        R[0, column] = c * x + v * (m[AXIS + 1] * z - m[AXIS + 2] * y) + along * m[AXIS]
        R[1, column] = c * y + v * (m[AXIS + 2] * x - m[AXIS] * z) + along * m[AXIS + 1]
        R[2, column] = c * z + v * (m[AXIS] * y - m[AXIS + 1] * x) + along * m[AXIS + 2]


@kernel(allocates=False)
def angle_between(A: Array, B: Array) -> float:
    """Angle of A^T B, (3, 3) each, from |A - B| = 2 sqrt(2) sin(angle / 2): exact where small."""
    square = 0.0
    for i in range(3):
        for j in range(3):
            square += (A[i, j] - B[i, j]) ** 2
    return 2.0 * math.asin(min(1.0, math.sqrt(square / 8.0)))


@kernel
def corner_kernel(m: Array, h: float, work: Array, R: Array, state: Array) -> None:
    """Write the deviations from a corner and their bounds into a cell's ``state``.

    Args:
        m: ``ToolCorner.numbers``.
        h: Half width of the cell.
        work: Memory of ``tool_deviation.cell_kernel``, with place and velocities of the tip.
        R: Rotation of the tip, shape (3, 3).
        state: State of the cell, with bounds of the tip's accelerations.
    """
    p, v, w, e, rate = work[3], work[4], work[5], work[6], work[7]
    curve, N = np.empty((3, 3)), np.empty((3, 3))
    u = _nearest(m, p, curve)
    state[Cell.ANGLE] = u
    square, along = 0.0, 0.0
    for k in range(3):
        square += curve[1, k] * curve[1, k]
        along += curve[1, k] * v[k]
    pace = along / square if square > 0.0 else 0.0
    for k in range(3):
        e[k] = p[k] - curve[0, k]
        rate[k] = v[k] - pace * curve[1, k]
    second = state[Cell.ACCELERATION] + pace * pace * m[BEND]
    reach = abs(pace) * h
    over = max(0.0, reach - u, u + reach - 1.0)
    state[Cell.POSITION] = norm(e[0], e[1], e[2])
    state[Cell.POSITION_BOUND] = farthest(e, rate, h) + 0.5 * second * h * h + over * m[RATE]
    _nominal_turn(m, u, N, curve[2])
    for k in range(3):
        rate[k] = w[k] - pace * curve[2, k]
    turning = state[Cell.ANGULAR] + pace * pace * m[TURN_BEND]
    state[Cell.ORIENTATION] = angle_between(N, R)
    state[Cell.ORIENTATION_BOUND] = (
        state[Cell.ORIENTATION]
        + norm(rate[0], rate[1], rate[2]) * h
        + 0.5 * turning * h * h
        + over * m[TURN_RATE]
    )


@kernel(allocates=False)
def _share(slope: float, u: float) -> float:
    """Place h on the first leg."""
    start = u * (1.0 + u * u * (-6.0 + u * (8.0 - 3.0 * u)))
    return slope * start + u * u * u * (10.0 + u * (-15.0 + 6.0 * u))


@kernel(allocates=False)
def _share_rate(slope: float, u: float) -> float:
    """dh/du."""
    start = 1.0 + u * u * (-18.0 + u * (32.0 - 15.0 * u))
    return slope * start + 30.0 * (u * (1.0 - u)) ** 2


@kernel(allocates=False)
def _add_leg(m: Array, first: int, s: float, rate: float, curve: Array) -> None:
    """Add place and velocity of a leg, whose numbers begin at ``first``, to the curve's."""
    if m[first + KIND] == LINE:
        for k in range(3):
            along = m[first + LENGTH] * m[first + ALONG + k]
            curve[0, k] += m[first + START + k] + s * along
            curve[1, k] += rate * along
        return
    angle, radius = s * m[first + SWEEP], m[first + LENGTH]
    cosine, sine = math.cos(angle), math.sin(angle)
    for k in range(3):
        a, b = m[first + ALONG + k], m[first + SIDE + k]
        curve[0, k] += m[first + CENTER + k] + radius * (cosine * a + sine * b)
        curve[1, k] += rate * m[first + SWEEP] * radius * (cosine * b - sine * a)


@kernel(allocates=False)
def _point(m: Array, u: float, curve: Array) -> None:
    """Write the curve's place and derivative at u into its first two rows."""
    second = m[SECOND_LEG : SECOND_LEG + SIZE]
    for k in range(3):
        # The corner is where the second leg begins.
        curve[0, k], curve[1, k] = -second[START + k], 0.0
    slope = m[SLOPE]
    _add_leg(m, FIRST_LEG, _share(slope, u), _share_rate(slope, u), curve)
    _add_leg(m, SECOND_LEG, 1.0 - _share(slope, 1.0 - u), _share_rate(slope, 1.0 - u), curve)


@kernel(allocates=False)
def _nearest(m: Array, p: Array, curve: Array) -> float:
    """Parameter of the curve nearest to a point; the curve's rows are left there."""
    nearest, u = np.inf, 0.0
    # Looks along a corner for the part of it that is nearest to the tool.
    looks = 16
    for i in range(looks + 1):
        _point(m, i / looks, curve)
        away = norm(p[0] - curve[0, 0], p[1] - curve[0, 1], p[2] - curve[0, 2])
        if away < nearest:
            nearest, u = away, i / looks
    # Steps of Gauss and Newton from the nearest of them.
    for _ in range(12):
        _point(m, u, curve)
        square, along = 0.0, 0.0
        for k in range(3):
            square += curve[1, k] * curve[1, k]
            along += curve[1, k] * (p[k] - curve[0, k])
        if square == 0.0:
            return u
        now = min(1.0, max(0.0, u + along / square))
        # A step shorter than this ends them.
        if abs(now - u) <= 1e-15:
            return u
        u = now
    _point(m, u, curve)
    return u


@kernel
def _nominal_turn(m: Array, u: float, N: Array, turn: Array) -> None:
    """Write the nominal orientation (3, 3) and its angular velocity by u (3,)."""
    A, B = np.empty((3, 3)), np.empty((3, 3))
    slope = m[SLOPE]
    first, second = m[FIRST_LEG : FIRST_LEG + SIZE], m[SECOND_LEG : SECOND_LEG + SIZE]
    nominal_kernel(first, _share(slope, u), A)
    nominal_kernel(second, 1.0 - _share(slope, 1.0 - u), B)
    # Of the second leg the turn since the corner.
    D = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                D[i, j] += B[i, k] * m[CORNER_ROTATION + 3 * j + k]
    one = _share_rate(slope, u) * first[TURN]
    other = _share_rate(slope, 1.0 - u) * second[TURN]
    for i in range(3):
        turn[i] = other * second[AXIS + i]
        for k in range(3):
            turn[i] += one * D[i, k] * first[AXIS + k]
        for j in range(3):
            N[i, j] = D[i, 0] * A[0, j] + D[i, 1] * A[1, j] + D[i, 2] * A[2, j]
