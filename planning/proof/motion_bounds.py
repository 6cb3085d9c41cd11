"""Cells of time for the certificate: how joints stray in one, and how far solids move with them.

On a cell [m - h, m + h] of time a joint is q(m + s) = c_0 + c_1 s + ..., its coefficients found by
Taylor's shift. Written apart from the planner's own kernels on purpose: a fault there must not be
believed here. What rounding can have done to any number is part of its bound.

How far a ball of radius r about a centre c, carried by joint j, moves seen from the body of joint
i, is bounded twice, from the motion joint by joint,

    D <- min(D + (rho_k + r + D) delta_k, 2 (rho_k + r + D))      for k = j, ..., i + 1

(rho_k the distance of c from axis k, delta_k how far the joint strays; a slide adds delta_k), and
from its velocity v and turning rate w in the middle of the cell and the largest acceleration a that
any of its points can have in it: along a direction u no point moves farther than

    |u.v| h + r |u x w| h + a h^2 / 2.
"""

import math

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.compiled.kernel import kernel
from planning.proof.separating_direction import Vector

#: Unit of rounding [relative].
_UNIT = 2.0**-53
#: What sums of products of bounds may have lost themselves [relative].
_OUTWARD = 1.0 + 1e-12
#: What a sum of products that cancel may have lost of the sum of their sizes [relative].
_CANCELLED = 1e-12

#: Columns of what ``enclose`` writes of each joint.
VALUE, STRAY, RATE, SPEED, ACCELERATION, BLUR = range(6)
COLUMNS = 6
#: Columns of what ``piece_bounds`` writes of each joint in each piece of a trajectory: least and
#: largest value, largest absolute rate and acceleration, what the next piece jumps by in value and
#: rate, and how far the true motion may be from what is computed of it.
LOWEST, HIGHEST, FASTEST, MAX_ACCELERATION, JUMP, VELOCITY_JUMP, UNSURE = range(7)
SURVEY_COLUMNS = 7
#: Columns of what ``displacement_bounds`` writes of each piece, seen from each joint's predecessor.
MOVED, BEND, VELOCITY, TURN = 0, 1, 2, 5
SWAY_COLUMNS = 8


@kernel
def enclose(coefficients: Array, at: float, half: float, room: Array, joints: Array) -> None:
    """Enclose one piece of a trajectory on a cell.

    Args:
        coefficients: Of the piece, in ascending powers of its own time, shape (n, k).
        at: The cell's middle in the piece's own time, 0 or more [s].
        half: Half the cell's length [s].
        room: To work in, shape (2, k).
        joints: Filled, shape (n, 6): the value in the middle; how far the joint strays from it at
            most in the cell; its rate in the middle; the largest absolute rate and acceleration in
            the cell; and how far the true motion may be from value and rate as they are told.
    """
    n, k = coefficients.shape
    c, size = room[0], room[1]
    # Each coefficient is the sum of at most k products: the same sum of absolute values, times
    # the unit for each operation, bounds what was rounded off.
    unit = 4.0 * (k + 1) * _UNIT
    for j in range(n):
        for i in range(k):
            c[i] = coefficients[j, i]
            size[i] = abs(c[i])
        for first in range(k - 1):
            for i in range(k - 2, first - 1, -1):
                c[i] += at * c[i + 1]
                size[i] += at * size[i + 1]
        blur = unit * size[0]
        rate = c[1] if k > 1 else 0.0
        stray, speed, acceleration, power, before = 0.0, 0.0, 0.0, 1.0, 0.0
        for i in range(1, k):
            most = abs(c[i]) + unit * size[i]
            stray += most * power * half
            speed += i * most * power
            acceleration += i * (i - 1) * most * before
            before, power = power, power * half
        joints[j, VALUE] = c[0]
        joints[j, STRAY] = (stray + blur) * _OUTWARD
        joints[j, RATE] = rate
        joints[j, SPEED] = speed * _OUTWARD
        joints[j, ACCELERATION] = acceleration * _OUTWARD
        joints[j, BLUR] = (blur + unit * (size[1] * half if k > 1 else 0.0)) * _OUTWARD


@kernel
def piece_bounds(breaks: Array, coefficients: Array, table: Array) -> None:
    """Enclose every piece of a trajectory as a whole, into a table of shape (m, n, 7)."""
    m, n, k = coefficients.shape
    room, joints, ends = np.empty((2, k)), np.empty((n, COLUMNS)), np.empty((n, COLUMNS))
    for i in range(m):
        length = piece_length(breaks, i)
        enclose(coefficients[i], 0.5 * length, 0.5 * length * _OUTWARD, room, joints)
        enclose(coefficients[i], length, 0.0, room, ends)
        for j in range(n):
            table[i, j, LOWEST] = joints[j, VALUE] - joints[j, STRAY]
            table[i, j, HIGHEST] = joints[j, VALUE] + joints[j, STRAY]
            table[i, j, FASTEST] = joints[j, SPEED]
            table[i, j, MAX_ACCELERATION] = joints[j, ACCELERATION]
            table[i, j, UNSURE] = joints[j, BLUR]
            table[i, j, JUMP], table[i, j, VELOCITY_JUMP] = 0.0, 0.0
            if i + 1 < m:
                rate = coefficients[i + 1, j, 1] if k > 1 else 0.0
                unsure = 2.0 * ends[j, BLUR] / length + 16.0 * _UNIT * joints[j, SPEED]
                jump = abs(coefficients[i + 1, j, 0] - ends[j, VALUE]) + ends[j, BLUR]
                table[i, j, JUMP] = jump + table[i, j, FASTEST] * 16.0 * _UNIT * length
                table[i, j, VELOCITY_JUMP] = abs(rate - ends[j, RATE]) + unsure


@kernel
def piece_length(breaks: Array, i: int) -> float:
    """Length of piece i [s]; the difference is rounded, a little more of it does no harm."""
    return float((breaks[i + 1] - breaks[i]) * (1.0 + 4.0 * _UNIT))


@kernel
def enclose_span(
    coefficients: Array,
    table: Array,
    first: int,
    last: int,
    middle: int,
    half: float,
    joints: Array,
) -> None:
    """``enclose`` pieces first .. last of a trajectory about the start of piece ``middle``.

    ``table`` is that of ``piece_bounds``. The motion differs by its jumps from one whose value and
    rate are continuous, and that one is enclosed.
    """
    n, k = coefficients.shape[1], coefficients.shape[2]
    for j in range(n):
        value = coefficients[middle, j, 0]
        low = high = value
        speed, acceleration, blur, jumps, kinks = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(first, last + 1):
            low, high = min(low, table[i, j, LOWEST]), max(high, table[i, j, HIGHEST])
            speed = max(speed, table[i, j, FASTEST])
            acceleration = max(acceleration, table[i, j, MAX_ACCELERATION])
            blur = max(blur, table[i, j, UNSURE])
            if i < last:
                jumps += table[i, j, JUMP]
                kinks += table[i, j, VELOCITY_JUMP]
        blur += jumps + kinks * 2.0 * half
        joints[j, VALUE] = value
        joints[j, STRAY] = (max(high - value, value - low) + blur) * _OUTWARD
        joints[j, RATE] = coefficients[middle, j, 1] if k > 1 else 0.0
        joints[j, SPEED] = (speed + kinks) * _OUTWARD
        joints[j, ACCELERATION] = acceleration * _OUTWARD
        joints[j, BLUR] = blur * _OUTWARD


@kernel
def place(
    joint: int, i: int, frames: Array, own: Array, middles: Array, poses: Array, centers: Array
) -> None:
    """Write pose (4, 4) and ball's centre (3,) of piece i in the base frame.

    Args:
        joint: The joint that carries it, -1 for none.
        i: The piece.
        frames: T_base_joint, shape (n, 4, 4).
        own: Poses of the pieces in the frames of their joints, shape (p, 4, 4).
        middles: Centres of their balls in these, shape (p, 3).
        poses: Filled at i, shape (p, 4, 4).
        centers: Filled at i, shape (p, 3).
    """
    for row in range(3):
        if joint < 0:
            centers[i, row] = middles[i, row]
            for column in range(4):
                poses[i, row, column] = own[i, row, column]
            continue
        a, b, c = frames[joint, row, 0], frames[joint, row, 1], frames[joint, row, 2]
        t = frames[joint, row, 3]
        centers[i, row] = a * middles[i, 0] + b * middles[i, 1] + c * middles[i, 2] + t
        for column in range(4):
            x, y, z = own[i, 0, column], own[i, 1, column], own[i, 2, column]
            poses[i, row, column] = a * x + b * y + c * z
        poses[i, row, 3] += t


@kernel
def displacement_bounds(
    types: Indices, frames: Array, centers: Array, i: int, radius: float, carrier: int,
    joints: Array, half: float, moves: Array,
) -> None:  # fmt: skip
    """How a ball carried by joint ``carrier`` moves on a cell, seen from every body before it.

    Args:
        types: Of the joints, shape (n,).
        frames: T_base_joint in the middle of the cell, shape (n, 4, 4).
        centers: Of all balls in the base frame, shape (p, 3) [m].
        i: Which ball.
        radius: Of the ball [m].
        carrier: The joint it moves with.
        joints: From ``enclose``, shape (n, 6).
        half: Half the cell's length [s].
        moves: Filled at i, shape (p, n, 8): row k is about joints k .. carrier moving. How far
            any point moves; what acceleration and rounding add to first order; the centre's
            velocity in the middle; the turning rate there.
    """
    x, y, z = centers[i, 0], centers[i, 1], centers[i, 2]
    far, speed, acceleration, blur = 0.0, 0.0, 0.0, 0.0
    vx, vy, vz, wx, wy, wz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(carrier, -1, -1):
        rate = joints[j, RATE]
        ax, ay, az = frames[j, 0, 2], frames[j, 1, 2], frames[j, 2, 2]
        if types[j] == 1:
            far += joints[j, STRAY]
            speed += joints[j, SPEED]
            acceleration += joints[j, ACCELERATION]
            blur += joints[j, BLUR]
            vx, vy, vz = vx + rate * ax, vy + rate * ay, vz + rate * az
        else:
            dx, dy, dz = x - frames[j, 0, 3], y - frames[j, 1, 3], z - frames[j, 2, 3]
            cx, cy, cz = ay * dz - az * dy, az * dx - ax * dz, ax * dy - ay * dx
            # Distance of any point of the ball from the axis, wherever the joints behind it are.
            lever = math.sqrt(cx * cx + cy * cy + cz * cz) + radius + far
            # Seen from the body before: the own pull, and twice the turn times what moves in it.
            most = joints[j, SPEED]
            acceleration += (joints[j, ACCELERATION] + most * most) * lever + 2.0 * most * speed
            speed += most * lever
            blur += joints[j, BLUR] * lever
            # A point never strays farther than the circle's diameter.
            far += min(lever * joints[j, STRAY], 2.0 * lever)
            vx, vy, vz = vx + rate * cx, vy + rate * cy, vz + rate * cz
            wx, wy, wz = wx + rate * ax, wy + rate * ay, wz + rate * az
        # The last term is what sums of the velocity's products can have rounded off.
        bend = 0.5 * acceleration * half * half + blur + _CANCELLED * speed * half
        first = math.sqrt(vx * vx + vy * vy + vz * vz)
        first += radius * math.sqrt(wx * wx + wy * wy + wz * wz)
        moves[i, j, MOVED] = min(far, first * half + bend) * _OUTWARD
        moves[i, j, BEND] = bend
        moves[i, j, VELOCITY], moves[i, j, VELOCITY + 1], moves[i, j, VELOCITY + 2] = vx, vy, vz
        moves[i, j, TURN], moves[i, j, TURN + 1], moves[i, j, TURN + 2] = wx, wy, wz


@kernel
def moved_along(moves: Array, i: int, j: int, radius: float, half: float, u: Vector) -> float:
    """How far any point of ball i moves along a unit direction on a cell, seen from before joint j.

    Args:
        moves: From ``displacement_bounds``.
        i: Which ball.
        j: The first joint that moves.
        radius: Of the ball [m].
        half: Half the cell's length [s].
        u: The direction.
    """
    x, y, z = u
    first = x * moves[i, j, VELOCITY] + y * moves[i, j, VELOCITY + 1]
    first += z * moves[i, j, VELOCITY + 2]
    wx, wy, wz = moves[i, j, TURN], moves[i, j, TURN + 1], moves[i, j, TURN + 2]
    a, b, c = y * wz - z * wy, z * wx - x * wz, x * wy - y * wx
    turned = radius * math.sqrt(a * a + b * b + c * c)
    moved = ((abs(first) + turned) * half + moves[i, j, BEND]) * _OUTWARD
    return float(min(moves[i, j, MOVED], moved))


@kernel
def outside_box(point: Array, i: int, boxes: Array, poses: Array, k: int) -> float:
    """Distance of row i of ``point`` (p, 3) from box k of its placed piece, 0 inside [m]."""
    square = 0.0
    x, y, z = (
        point[i, 0] - poses[k, 0, 3],
        point[i, 1] - poses[k, 1, 3],
        point[i, 2] - poses[k, 2, 3],
    )
    for axis in range(3):
        local = x * poses[k, 0, axis] + y * poses[k, 1, axis] + z * poses[k, 2, axis]
        out = max(abs(local - boxes[k, axis]) - boxes[k, 3 + axis], 0.0)
        square += out * out
    return math.sqrt(square)


@kernel
def reach(types: Indices, offsets: Array, joints: Array) -> float:
    """Size of the largest numbers that the joints' frames are summed from on a cell [m]."""
    total = 0.0
    for j in range(offsets.shape[0]):
        x, y, z = offsets[j, 0, 3], offsets[j, 1, 3], offsets[j, 2, 3]
        total += math.sqrt(x * x + y * y + z * z)
        if types[j] == 1:
            total += abs(joints[j, VALUE]) + joints[j, STRAY]
    return total
