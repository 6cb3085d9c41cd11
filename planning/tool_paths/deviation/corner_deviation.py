"""Deviation of the tool from a rounded corner over a cell of time, for planners.

Of the parameter u of the corner's curve c the one nearest to the tool is found in the middle of the
cell, and taken to run at a constant pace u' = v c' / |c'|^2. With it e = p - c(u) changes at
v - u' c', its second derivative is at most P + u'^2 max |c''|, and the angle to the nominal
orientation N(u) changes at most by the relative angular velocity. Any pace gives a bound; this one
a sharp one. Beyond its ends the curve counts as going straight on, and what the tool overshoots is
added.
"""

import math

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
    SIDE,
    SIZE,
    START,
    SWEEP,
    TURN,
)
from planning.tool_paths.deviation.nominal import (
    CELL_ACCELERATION,
    CELL_ANGLE,
    CELL_ANGULAR,
    CELL_ORIENTATION,
    CELL_ORIENTATION_BOUND,
    CELL_POSITION,
    CELL_POSITION_BOUND,
    angle_between,
    farthest,
    nominal_kernel,
    norm,
)

#: Looks along a corner for the part of it that is nearest to the tool.
_LOOKS = 16
#: Steps of Gauss and Newton from the nearest of them.
_STEPS = 12
#: A step shorter than this ends them.
_SMALL_STEP = 1e-15


@kernel
def corner_kernel(m: Array, h: float, work: Array, R: Array, state: Array) -> None:
    """Write the deviations from a corner and their bounds into a cell's ``state``.

    Args:
        m: ``ToolCorner.numbers``.
        h: Half width of the cell.
        work: Of ``tool_deviation.cell_kernel``, with place and velocities of the tip.
        R: Rotation of the tip, shape (3, 3).
        state: Of the cell, with bounds of the tip's accelerations.
    """
    p, v, w, e, rate = work[3], work[4], work[5], work[6], work[7]
    curve, N = np.empty((3, 3)), np.empty((3, 3))
    u = _nearest(m, p, curve)
    state[CELL_ANGLE] = u
    square, along = 0.0, 0.0
    for k in range(3):
        square += curve[1, k] * curve[1, k]
        along += curve[1, k] * v[k]
    pace = along / square if square > 0.0 else 0.0
    for k in range(3):
        e[k] = p[k] - curve[0, k]
        rate[k] = v[k] - pace * curve[1, k]
    second = state[CELL_ACCELERATION] + pace * pace * m[BEND]
    reach = abs(pace) * h
    over = max(0.0, reach - u, u + reach - 1.0)
    state[CELL_POSITION] = norm(e[0], e[1], e[2])
    state[CELL_POSITION_BOUND] = farthest(e, rate, h) + 0.5 * second * h * h + over * m[RATE]
    _nominal_turn(m, u, N, curve[2])
    for k in range(3):
        rate[k] = w[k] - pace * curve[2, k]
    turning = state[CELL_ANGULAR] + pace * pace * m[TURN_BEND]
    state[CELL_ORIENTATION] = angle_between(N, R)
    state[CELL_ORIENTATION_BOUND] = (
        state[CELL_ORIENTATION]
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
    for i in range(_LOOKS + 1):
        _point(m, i / _LOOKS, curve)
        away = norm(p[0] - curve[0, 0], p[1] - curve[0, 1], p[2] - curve[0, 2])
        if away < nearest:
            nearest, u = away, i / _LOOKS
    for _ in range(_STEPS):
        _point(m, u, curve)
        square, along = 0.0, 0.0
        for k in range(3):
            square += curve[1, k] * curve[1, k]
            along += curve[1, k] * (p[k] - curve[0, k])
        if square == 0.0:
            return u
        now = min(1.0, max(0.0, u + along / square))
        if abs(now - u) <= _SMALL_STEP:
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
