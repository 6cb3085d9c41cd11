"""Constraints along the edges of planners, bounded for every instant, not at samples.

On a cell of time [t - h, t + h] joint j is q_j(t) + a_j u + e_j with |u| <= 1, a_j = q_j'(t) h and
|e_j| <= s_j, the sum of the higher powers; it moves by delta_j = |a_j| + s_j at most. A point that
joints j carry then stays within

    E = sum_j l_j s_j + sum_j l_j delta_j (delta_j + 2 sum_(k inside j) delta_k) / 2

of the segment x(t) + u V, V its velocity times h and l_j the most it is from axis j; a direction
within sum s_j + (sum delta_j)^2 / 2 of A(t) + u W x A(t); an angle changes by sum delta_j at most.
What these bounds leave open is looked at again on the halves, so the residual is bounded for all t.
The proof bounds residuals by code of its own, ``planning.proof.constraints.residual_bounds``.
"""

import math
from enum import IntEnum

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import Vector, cross, dot, load, rotate, subtract, turned_back
from kinematics.arrays import Array
from kinematics.forward import frames_kernel
from kinematics.model.chain import Chain
from planning.constraints.row import Column, RowKind
from planning.constraints.row_value import (
    axis_kernel,
    log_kernel,
    point_kernel,
    relative_point_kernel,
    residual_kernel,
    value_kernel,
)


class EdgeVerdict(IntEnum):
    """Verdict on an edge."""

    HOLDS = 0
    VIOLATED = 1
    UNDECIDED = 2


#: Residuals that count as none along a motion: what rounding leaves of a bound that is met exactly
#: [m or rad].
TOLERANCE = 1e-6
# Numba reads module-level integers as constants, enums more slowly.
_JOINT = int(RowKind.JOINT)
_COORDINATE = int(RowKind.COORDINATE)
_DISTANCE = int(RowKind.DISTANCE)
_ANGLE = int(RowKind.ANGLE)
_LOOK = int(RowKind.LOOK)
#: Halvings of an edge at most.
_DEPTH = 60
#: Cells spent on an edge of a planner.
EDGE_CELLS = 4_000


def edge_holds(chain: Chain, packed: Array, curve: Array) -> bool:
    """Whether q(s) = sum_k curve[:, k] s^k keeps packed rows for all 0 <= s <= 1.

    Args:
        chain: The robot.
        packed: Shape (m, WIDTH).
        curve: Shape (n, k).
    """
    verdict, _ = edge_kernel(chain.model, np.array(packed), np.array(curve), EDGE_CELLS)
    return bool(verdict == EdgeVerdict.HOLDS)


@kernel
def edge_kernel(chain: Array, packed: Array, curve: Array, max_cells: int) -> tuple[int, float]:
    """Verdict on q(s) = sum_k curve[:, k] s^k (n, k) for 0 <= s <= 1 and packed rows (m, WIDTH).

    Cells are halved depth first, the earlier half first; what a cell settles of the rows is not
    looked at again on its halves. Once there is a violation only what comes before it is.

    Returns:
        The verdict, and where the first violation is, or the first cell that can't be decided.
    """
    n, m = curve.shape[0], packed.shape[0]
    q, linear, curved = np.empty(n), np.empty(n), np.empty(n)
    frames, E = np.empty((n, 4, 4)), np.empty((3, 3))
    unsettled = np.empty((_DEPTH + 2, m), dtype=np.bool_)
    unsettled[0, :] = True
    lows, highs = np.empty(_DEPTH + 2), np.empty(_DEPTH + 2)
    depths = np.empty(_DEPTH + 2, dtype=np.int64)
    lows[0], highs[0], depths[0] = 0.0, 1.0, 0
    top, cells, violated = 1, 0, math.inf
    # Halvings in search of the first violation at most.
    search_depth = 40
    while top > 0:
        top -= 1
        low, high, depth = lows[top], highs[top], depths[top]
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        expand_kernel(curve, middle, half, q, linear, curved)
        frames_kernel(chain, q, frames)
        cells += 1
        settled, worst = True, -math.inf
        for i in range(m):
            unsettled[depth + 1, i] = False
            if unsettled[depth, i]:
                residual, bound = bound_kernel(chain, q, frames, packed[i], linear, curved, E)
                worst = max(worst, residual)
                unsettled[depth + 1, i] = bound > TOLERANCE
                settled = settled and bound <= TOLERANCE
        if settled:
            continue
        if worst > TOLERANCE:
            violated, top = middle, 0
        # So small a cell is not halved again: rounding decides there.
        smallest = half <= 1e-13 * (1.0 + abs(middle))
        if depth + 2 > _DEPTH or cells >= max_cells or smallest:
            return (
                (EdgeVerdict.VIOLATED, violated)
                if violated < math.inf
                else (EdgeVerdict.UNDECIDED, middle)
            )
        # The left half is taken first; both share what is open one level down.
        if violated == math.inf:
            lows[top], highs[top], depths[top] = middle, high, depth + 1
            top += 1
        elif depth >= search_depth:
            break
        lows[top], highs[top], depths[top] = low, middle, depth + 1
        top += 1
    return (EdgeVerdict.VIOLATED, violated) if violated < math.inf else (EdgeVerdict.HOLDS, 1.0)


@kernel
def expand_kernel(
    coefficients: Array, at: float, half: float, q: Array, linear: Array, curved: Array
) -> None:
    """Write q(at), q'(at) half, and the sum of |c_k| half^k over the higher powers, each (n,)."""
    n, k = coefficients.shape
    c = np.empty(k)
    for j in range(n):
        for i in range(k):
            c[i] = coefficients[j, i]
        # Repeated synthetic division: the coefficients about ``at``.
        for first in range(k - 1):
            for i in range(k - 2, first - 1, -1):
                c[i] += at * c[i + 1]
        q[j] = c[0]
        linear[j] = c[1] * half if k > 1 else 0.0
        total, power = 0.0, half
        for i in range(2, k):
            power *= half
            total += abs(c[i]) * power
        curved[j] = total


@kernel
def bound_kernel(
    chain: Array, q: Array, frames: Array, row: Array, linear: Array, curved: Array, E: Array
) -> tuple[float, float]:
    """A row's residual in the middle of a cell, and an upper bound of it all over the cell."""
    value, _, covector = value_kernel(q, frames, row, E)
    residual, _ = residual_kernel(value, row)
    kind = int(row[Column.KIND])
    if kind == _JOINT:
        j = int(row[Column.CARRIER])
        return residual, residual + abs(linear[j]) + curved[j]
    movement = movement_kernel(chain, frames, row, linear, curved)
    V, W, turn, _, moved, error = movement
    if kind == _COORDINATE:
        d = load(row, Column.DIRECTION)
        change = min(abs(dot(d, V)) + error, moved)
        return residual, residual + change
    if kind == _DISTANCE:
        return residual, _distance_bound(frames, row, V, error, moved) - row[Column.UPPER]
    if kind == _ANGLE:
        a = axis_kernel(frames, row)
        d = load(row, Column.DIRECTION)
        moved, error = _axis_movement(chain, frames, row, linear, curved)
        cosine = min(max(dot(a, d) - abs(dot(d, cross(W, a))) - error, -1.0), 1.0)
        # A chord of this length spans an angle that is somewhat larger.
        swept = min(turn, 2.0 * math.asin(min(0.5 * moved, 1.0)))
        return residual, min(math.acos(cosine), value + swept) - row[Column.UPPER]
    if kind == _LOOK:
        x = relative_point_kernel(frames, row, point_kernel(frames, row))
        c = load(row, Column.CENTER)
        y = subtract(x, c)
        distance = math.sqrt(dot(y, y))
        sight = math.asin(moved / distance) if moved < distance else math.pi
        return residual, min(value + turn + sight, math.pi) - row[Column.UPPER]
    return residual, residual + _rotation_change(frames, row, covector, movement, E)


@kernel(allocates=False)
def _axis_movement(
    chain: Array, frames: Array, row: Array, linear: Array, curved: Array
) -> tuple[float, float]:
    """The most that the row's axis moves on the unit sphere, and that it leaves W x A, over a cell.

    As of a point in ``movement_kernel``, with |z x A| for the distance from a joint's axis: a joint
    along which it points does not move it.
    """
    carrier, reference = int(row[Column.CARRIER]), int(row[Column.REFERENCE])
    first, last = min(carrier, reference) + 1, max(carrier, reference)
    a = load(row, Column.AXIS)
    if carrier >= 0:
        a = rotate(frames[carrier], a)
    inside = 0.0
    for j in range(first, last + 1):
        if chain[1 + j, 0] == 0.0:
            inside += abs(linear[j]) + curved[j]
    moved, error = 0.0, 0.0
    for step in range(last - first + 1):
        j = last - step if carrier > reference else first + step
        if chain[1 + j, 0] == 1.0:
            continue
        delta = abs(linear[j]) + curved[j]
        inside -= delta
        arm = cross((frames[j, 0, 2], frames[j, 1, 2], frames[j, 2, 2]), a)
        lever = min(math.sqrt(dot(arm, arm)) + moved, 1.0)
        error += lever * curved[j] + 0.5 * lever * delta * (delta + 2.0 * inside)
        moved += lever * delta
    return moved, error


@kernel(allocates=False)
def _distance_bound(frames: Array, row: Array, V: Vector, error: float, moved: float) -> float:
    """The largest distance over a cell: a convex function, largest at an end of the segment."""
    d = load(row, Column.DIRECTION)
    x = relative_point_kernel(frames, row, point_kernel(frames, row))
    c = load(row, Column.CENTER)
    y = subtract(x, c)
    along, across = dot(d, y), dot(d, V)
    y = (y[0] - along * d[0], y[1] - along * d[1], y[2] - along * d[2])
    v = (V[0] - across * d[0], V[1] - across * d[1], V[2] - across * d[2])
    largest = 0.0
    for sign in (1.0, -1.0):
        end = (y[0] + sign * v[0], y[1] + sign * v[1], y[2] + sign * v[2])
        largest = max(largest, math.sqrt(dot(end, end)))
    return min(largest + error, math.sqrt(dot(y, y)) + moved)


@kernel(allocates=False)
def _rotation_change(
    frames: Array,
    row: Array,
    covector: Vector,
    movement: tuple[Vector, Vector, float, float, float, float],
    E: Array,
) -> float:
    """Bound of the change of a component of log(K X) while X turns by ``turn`` at most.

    |J^-1| = (t / 2) / sin(t / 2) at a rotation by t; across half a turn the vector changes its sign
    alone. For t <= 1 the second derivative is at most 1.75 times the square of the rate: |J^-1| is
    at most 1.05, its slope (1 / 2 + 0.175) times that, and the rate turns at most by its own.
    """
    _, W, turn, turn_curved, _, _ = movement
    e = log_kernel(E)
    largest = math.sqrt(dot(e, e)) + turn
    factor = 0.5 * math.pi
    if largest < math.pi:
        factor = 0.5 * largest / math.sin(0.5 * largest) if largest > 1e-6 else 1.0
    change = factor * turn
    if 1.05 * largest < 1.0:
        w = covector
        if row[Column.REFERENCE] >= 0.0:
            w = turned_back(frames[int(row[Column.REFERENCE])], w)
        change = min(change, abs(dot(w, W)) + 1.05 * turn_curved + 0.875 * turn * turn)
    return change


@kernel(allocates=False)
def movement_kernel(
    chain: Array, frames: Array, row: Array, linear: Array, curved: Array
) -> tuple[Vector, Vector, float, float, float, float]:
    """Relative motion of a row's bodies over a cell.

    Returns:
        Velocity of the point and angular velocity in the reference, both times the half cell; the
        most that directions turn, and the part of it that is not linear; the most that the point
        moves, and the most that it leaves its straight line.
    """
    carrier, reference = int(row[Column.CARRIER]), int(row[Column.REFERENCE])
    P = point_kernel(frames, row)
    first, last = min(carrier, reference) + 1, max(carrier, reference)
    outwards = carrier > reference
    sign = 1.0 if outwards else -1.0
    turn = 0.0
    for j in range(first, last + 1):
        if chain[1 + j, 0] == 0.0:
            turn += abs(linear[j]) + curved[j]
    inside = turn
    vx, vy, vz, wx, wy, wz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    moved, error, quadratic, turn_curved = 0.0, 0.0, 0.0, 0.0
    for step in range(last - first + 1):
        # From the point's side to the reference's.
        j = last - step if outwards else first + step
        F = frames[j]
        z = (F[0, 2], F[1, 2], F[2, 2])
        delta = abs(linear[j]) + curved[j]
        a = sign * linear[j]
        if chain[1 + j, 0] == 1.0:
            vx, vy, vz = vx + a * z[0], vy + a * z[1], vz + a * z[2]
            moved += delta
            error += curved[j]
            quadratic += 2.0 * delta * inside
            continue
        inside -= delta
        arm = cross(z, (P[0] - F[0, 3], P[1] - F[1, 3], P[2] - F[2, 3]))
        lever = math.sqrt(dot(arm, arm)) + moved
        vx, vy, vz = vx + a * arm[0], vy + a * arm[1], vz + a * arm[2]
        wx, wy, wz = wx + a * z[0], wy + a * z[1], wz + a * z[2]
        turn_curved += curved[j]
        error += lever * curved[j]
        quadratic += lever * delta * (delta + 2.0 * inside)
        moved += min(lever * delta, 2.0 * lever)
    V, W = (vx, vy, vz), (wx, wy, wz)
    if reference >= 0:
        V = turned_back(frames[reference], (vx, vy, vz))
        W = turned_back(frames[reference], (wx, wy, wz))
    return V, W, turn, turn_curved, moved, error + 0.5 * quadratic
