"""Bounds of how far solids move over an interval of time, by what is known of their joints.

How far a ball of radius r about a centre c, of body j, moves seen from a body i that j hangs on, is
bounded from the motion joint by joint,

    D <- min(D + (rho_k + r + D) delta_k, 2 (rho_k + r + D))      for k = j, ... up to i

(rho_k the distance of c from axis k, delta_k the radius of joint k's values; a slide adds
delta_k); from the velocity v and turning rate w in the middle of the interval [-h, h] and the
largest acceleration a_1 that any point can have in it: along a direction u no point moves farther
than

    |u.v| h + r |u x w| h + a_1 h^2 / 2;

and from the accelerations a and b of the centre and of the turning, too, and the largest jerk j_1:
a point c + p is, but for j_1 h^3 / 6, displaced along u at time s by

    s u.v + s^2/2 u.a + p.(s u x w + s^2/2 (u x b + (u.w) w - |w|^2 u)),

of a whole solid a support function (``lowest``), concave in what it is taken of: its least value
over the interval is no less than those at the corners of a hull of that curve.
"""

import math

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from compiled.vec3 import Vector, cross, dot
from kinematics.arrays import Array, Indices
from planning.proof.collision.separating_direction import height
from planning.proof.motion_bounds import (
    ACCELERATION,
    BOW,
    BOW_ROUNDING,
    JERK,
    OUTWARD,
    PARENT,
    RADIUS,
    RATE,
    ROUNDING,
    SPEED,
    TYPE,
)

#: What a sum of products that cancel may have lost of the sum of their sizes [relative].
_CANCELLED = 1e-12

# Columns of what ``displacement_bounds`` writes, seen from the body before each joint.
#: How far any point moves at most [m].
MOVED = 0
#: What acceleration and rounding add to first order [m].
BEND = 1
#: What jerk and rounding add to second order; infinite where that is no better [m].
TWIST = 2
#: First of the three columns of the centre's velocity in the middle [m/s].
VELOCITY = 3
#: First of the three columns of the turning rate in the middle [rad/s].
TURN = 6
#: First of the three columns of the centre's acceleration in the middle [m/s^2].
CURVE = 9
#: First of the three columns of the turning's acceleration in the middle [rad/s^2].
SPIN = 12
MOVE_COLUMNS = 15

Mask = NDArray[np.bool_]

#: Turns in the interval beyond which second order is not looked at [rad]: so directions stay of the
#: size of 1, for which rounding is bounded.
_MOST_TURN = 1.0


@kernel(allocates=False)
def displacement_bounds(
    bodies: Indices,
    frames: Array,
    ball: tuple[Vector, float],
    carrier: int,
    joints: Array,
    half: float,
    asked: Mask,
    moves: Array,
) -> None:
    """Bound how a ball carried by a joint moves on an interval, seen from bodies before it.

    Args:
        bodies: Rows TYPE and PARENT, shape (2, b).
        frames: T_base_body in the middle of the interval, shape (b, 4, 4).
        ball: Centre of the ball in the base frame, and its radius [m].
        carrier: The body it moves with.
        joints: Joints from ``enclose`` and ``enclose_mimic_joints``, shape (b, JOINT_COLUMNS).
        half: Half the interval's length [s].
        asked: Rows of ``moves`` that are asked for, shape (b,).
        moves: Row k is filled for each body k - 1 before the carrier: seen from there, columns
            MOVED to SPIN, shape (b, MOVE_COLUMNS). Of rows that are not asked for MOVED, BEND and
            TWIST are infinite: they prove nothing.
    """
    center, radius = ball
    j, far, speed, acceleration, jerk = carrier, 0.0, 0.0, 0.0, 0.0
    rounded, bow_rounded, turns, spins, v = 0.0, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0)
    w, a, b = v, v, v
    while j >= 0:
        rate, bow, fastest, steepest = (
            joints[j, RATE], joints[j, BOW], joints[j, SPEED], joints[j, ACCELERATION],
        )  # fmt: skip
        axis = (frames[j, 0, 2], frames[j, 1, 2], frames[j, 2, 2])
        if bodies[TYPE, j] == 1:
            far, jerk = far + joints[j, RADIUS], jerk + joints[j, JERK]
            speed, acceleration = speed + fastest, acceleration + steepest
            rounded, bow_rounded = (
                rounded + joints[j, ROUNDING], bow_rounded + joints[j, BOW_ROUNDING],
            )  # fmt: skip
            v, a = _add(v, rate, axis), _add(a, bow, axis)
        else:
            arm = cross(
                axis,
                (
                    center[0] - frames[j, 0, 3],
                    center[1] - frames[j, 1, 3],
                    center[2] - frames[j, 2, 3],
                ),
            )
            # Distance of any point of the ball from the axis, wherever the joints behind it are.
            lever = math.sqrt(dot(arm, arm)) + radius + far
            # Seen from the body before: with what moves in it, Coriolis' terms, and what turns.
            around = steepest + fastest * fastest
            jerk += (joints[j, JERK] + fastest * (3.0 * steepest + fastest * fastest)) * lever
            jerk += 3.0 * (around * speed + fastest * acceleration)
            acceleration += around * lever + 2.0 * fastest * speed
            speed += fastest * lever
            rounded += joints[j, ROUNDING] * lever
            bow_rounded += joints[j, BOW_ROUNDING] * lever
            # No point is displaced by more than the circle's diameter.
            far += min(lever * joints[j, RADIUS], 2.0 * lever)
            a = _add(_add(a, 2.0 * rate, cross(axis, v)), bow, arm)
            a, b = (
                _add(a, rate * rate, cross(axis, arm)),
                _add(_add(b, rate, cross(axis, w)), bow, axis),
            )
            v, w = _add(v, rate, arm), _add(w, rate, axis)
            spins, turns = spins + (steepest + fastest * turns), turns + fastest
        # From here on j is the row, the number after that of the body it is seen from.
        j = bodies[PARENT, j] + 1
        if not asked[j]:
            moves[j, MOVED], moves[j, BEND], moves[j, TWIST] = math.inf, math.inf, math.inf
            j -= 1
            continue
        # The last terms are what sums of products can have rounded off.
        lost = rounded + _CANCELLED * speed * half
        bend = 0.5 * acceleration * half * half + lost
        turn = math.sqrt(dot(w, w))
        first = math.sqrt(dot(v, v)) + radius * turn
        moved = min(far, first * half + bend)
        lost += bow_rounded - rounded + _CANCELLED * acceleration * half * half
        twist = jerk * half * half * half / 6.0 + lost
        if twist < bend and half * (turns + half * spins) <= _MOST_TURN:
            second = math.sqrt(dot(a, a)) + radius * (math.sqrt(dot(b, b)) + turn * turn)
            moved = min(moved, (first + 0.5 * half * second) * half + twist)
            moves[j, TWIST] = twist
        else:
            moves[j, TWIST] = math.inf
        moves[j, MOVED], moves[j, BEND] = moved * OUTWARD, bend
        for row in range(3):
            moves[j, VELOCITY + row], moves[j, TURN + row] = v[row], w[row]
            moves[j, CURVE + row], moves[j, SPIN + row] = a[row], b[row]
        j -= 1


@kernel(allocates=False)
def meeting_body(bodies: Indices, a: int, b: int) -> int:
    """The last body that both a and b hang on, -1 for the base; one of them where the other does.

    Bodies have larger numbers than those before them.
    """
    while a != b:
        if a > b:
            a = bodies[PARENT, a]
        else:
            b = bodies[PARENT, b]
    return a


@kernel(allocates=False, inline="code")
def _add(a: Vector, s: float, b: Vector) -> Vector:
    """The sum a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@kernel(allocates=False)
def displacement_along(moves: Array, j: int, radius: float, half: float, u: Vector) -> float:
    """Displacement bound of a ball's points along a unit direction, seen from body j - 1 [m].

    Args:
        moves: Bounds of ``displacement_bounds``, shape (b, MOVE_COLUMNS).
        j: The number after that of the body it is seen from.
        radius: Radius of the ball [m].
        half: Half the interval's length [s].
        u: The direction.
    """
    first = dot(u, _columns(moves, j, VELOCITY))
    across = cross(u, _columns(moves, j, TURN))
    moved = (
        (abs(first) + radius * math.sqrt(dot(across, across))) * half + moves[j, BEND]
    ) * OUTWARD
    return float(min(moves[j, MOVED], moved))


@kernel(allocates=False, inline="code")
def _columns(moves: Array, j: int, column: int) -> Vector:
    return moves[j, column], moves[j, column + 1], moves[j, column + 2]


@kernel(allocates=False)
def lowest(
    kind: int, size: Vector, columns: Array, span: tuple[int, int], poses: Array, i: int,
    u: Vector, way: tuple[Vector, Array, int, float],
) -> float:  # fmt: skip
    """Lower bound of u.x over all points x of a piece and all of the interval, to second order [m].

    Over [-h, h] the curve of what a support is taken of is c_0 + s c_1 + s^2/2 c_2: it lies in the
    hull of its ends and of c_0 - h/2 c_1 and c_0 + h/2 c_1 (Bezier's points of both halves).

    Args:
        kind: Kind of the piece's core, no half-space.
        size: Radius, half height and rounding of the piece [m].
        columns: Vertices in their pieces' frames, shape (3, v) [m].
        span: Corners of the piece, from and to before.
        poses: Poses of all pieces in the middle of the interval, shape (e, 4, 4).
        i: The piece.
        u: A unit direction.
        way: The centre of the piece's ball, ``moves`` of ``displacement_bounds`` and which of its
            rows holds, its TWIST finite; half the interval's length [s].
    """
    c, moves, j, half = way
    v, w = _columns(moves, j, VELOCITY), _columns(moves, j, TURN)
    a, b = _columns(moves, j, CURVE), _columns(moves, j, SPIN)
    first = cross(u, w)
    second = _add(_add(cross(u, b), dot(u, w), w), -dot(w, w), u)
    along, curve, least = dot(u, v), dot(u, a), math.inf
    for corner in range(4):
        s = half if corner % 2 == 0 else -half
        square = 0.5 * half * half
        if corner >= 2:
            s, square = 0.5 * s, 0.0
        turned = _add((s * first[0], s * first[1], s * first[2]), square, second)
        # u + turned, taken of the points seen from the centre: u.c and turned.c are told apart.
        d = (-u[0] - turned[0], -u[1] - turned[1], -u[2] - turned[2])
        at = s * along + square * curve - dot(turned, c)
        least = min(least, at - height(kind, size, columns, span[0], span[1], poses, i, d))
    return float(least - moves[j, TWIST] * OUTWARD)
