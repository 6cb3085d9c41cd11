"""Bounds of motion over an interval of time, for joints and for the solids that they carry.

On an interval [m - h, m + h] of time a joint is q(m + s) = c_0 + c_1 s + ..., its coefficients
found by Taylor's shift. Written apart from the planner's own kernels on purpose: a fault there must
not be believed here. What rounding can have done to any number is part of its bound.

How far a ball of radius r about a centre c, carried by joint j, moves seen from the body of joint
i, is bounded twice, from the motion joint by joint,

    D <- min(D + (rho_k + r + D) delta_k, 2 (rho_k + r + D))      for k = j, ..., i + 1

(rho_k the distance of c from axis k, delta_k the radius of joint k's values; a slide adds
delta_k), and from its velocity v and turning rate w in the middle of the interval and the largest
acceleration a that any of its points can have in it: along a direction u no point moves farther
than

    |u.v| h + r |u x w| h + a h^2 / 2.
"""

import math

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.compiled.kernel import kernel
from planning.proof.separating_direction import Vector

#: Unit of rounding [relative].
UNIT_ROUNDOFF = 2.0**-53
#: What sums of products of bounds may have lost themselves [relative].
OUTWARD = 1.0 + 1e-12
#: What a sum of products that cancel may have lost of the sum of their sizes [relative].
_CANCELLED = 1e-12

# Columns of what ``enclose`` writes of each joint.
#: Its value in the middle of the interval [rad or m].
VALUE = 0
#: How far its values in the interval are from that at most [rad or m].
RADIUS = 1
#: Its rate in the middle [rad/s or m/s].
RATE = 2
#: Its largest absolute rate in the interval [rad/s or m/s].
SPEED = 3
#: Its largest absolute acceleration in the interval [rad/s^2 or m/s^2].
ACCELERATION = 4
#: How far the true motion may be from value and rate as they are told [rad or m].
ROUNDING = 5
JOINT_COLUMNS = 6

# Columns of what ``piece_bounds`` writes of each joint in each piece of a trajectory.
#: Least value [rad or m].
LOWEST = 0
#: Largest value [rad or m].
HIGHEST = 1
#: Largest absolute rate [rad/s or m/s].
FASTEST = 2
#: Largest absolute acceleration [rad/s^2 or m/s^2].
MAX_ACCELERATION = 3
#: What the next piece jumps by in value [rad or m].
VALUE_JUMP = 4
#: What the next piece jumps by in rate [rad/s or m/s].
VELOCITY_JUMP = 5
#: How far the true motion may be from what is computed of it [rad or m].
PIECE_ROUNDING = 6
PIECE_COLUMNS = 7

# Columns of what ``displacement_bounds`` writes, seen from the predecessor of each joint.
#: How far any point moves at most [m].
MOVED = 0
#: What acceleration and rounding add to first order [m].
BEND = 1
#: First of the three columns of the centre's velocity in the middle [m/s].
VELOCITY = 2
#: First of the three columns of the turning rate in the middle [rad/s].
TURN = 5
MOVE_COLUMNS = 8


@kernel(allocates=False)
def enclose(coefficients: Array, at: float, half: float, scratch: Array, joints: Array) -> None:
    """Enclose one piece of a trajectory on an interval.

    Args:
        coefficients: Of the piece, in ascending powers of its own time, shape (n, k).
        at: The interval's middle in the piece's own time, 0 or more [s].
        half: Half the interval's length [s].
        scratch: Shape (2, k).
        joints: Filled, columns VALUE to ROUNDING, shape (n, JOINT_COLUMNS).
    """
    n, k = coefficients.shape
    c, size = scratch[0], scratch[1]
    # Each coefficient is the sum of at largest k products: the same sum of absolute values, times
    # the unit for each operation, bounds what was rounded off.
    unit = 4.0 * (k + 1) * UNIT_ROUNDOFF
    for j in range(n):
        for i in range(k):
            c[i] = coefficients[j, i]
            size[i] = abs(c[i])
        for first in range(k - 1):
            for i in range(k - 2, first - 1, -1):
                c[i] += at * c[i + 1]
                size[i] += at * size[i + 1]
        rounded = unit * size[0]
        rate = c[1] if k > 1 else 0.0
        radius, speed, acceleration, power, lower_power = 0.0, 0.0, 0.0, 1.0, 0.0
        for i in range(1, k):
            largest = abs(c[i]) + unit * size[i]
            radius += largest * power * half
            speed += i * largest * power
            acceleration += i * (i - 1) * largest * lower_power
            lower_power, power = power, power * half
        joints[j, VALUE] = c[0]
        joints[j, RADIUS] = (radius + rounded) * OUTWARD
        joints[j, RATE] = rate
        joints[j, SPEED] = speed * OUTWARD
        joints[j, ACCELERATION] = acceleration * OUTWARD
        joints[j, ROUNDING] = (rounded + unit * (size[1] * half if k > 1 else 0.0)) * OUTWARD


@kernel
def piece_bounds(breaks: Array, coefficients: Array, table: Array) -> None:
    """Enclose every piece of a trajectory as a whole.

    Args:
        breaks: Shape (m + 1,) [s].
        coefficients: Shape (m, n, k).
        table: Filled, columns LOWEST to PIECE_ROUNDING, shape (m, n, PIECE_COLUMNS).
    """
    m, n, k = coefficients.shape
    scratch = np.empty((2, k))
    joints, ends = np.empty((n, JOINT_COLUMNS)), np.empty((n, JOINT_COLUMNS))
    for i in range(m):
        length = piece_length(breaks, i)
        enclose(coefficients[i], 0.5 * length, 0.5 * length * OUTWARD, scratch, joints)
        enclose(coefficients[i], length, 0.0, scratch, ends)
        for j in range(n):
            table[i, j, LOWEST] = joints[j, VALUE] - joints[j, RADIUS]
            table[i, j, HIGHEST] = joints[j, VALUE] + joints[j, RADIUS]
            table[i, j, FASTEST] = joints[j, SPEED]
            table[i, j, MAX_ACCELERATION] = joints[j, ACCELERATION]
            table[i, j, PIECE_ROUNDING] = joints[j, ROUNDING]
            table[i, j, VALUE_JUMP], table[i, j, VELOCITY_JUMP] = 0.0, 0.0
            if i + 1 < m:
                rate = coefficients[i + 1, j, 1] if k > 1 else 0.0
                rounded = 2.0 * ends[j, ROUNDING] / length + 16.0 * UNIT_ROUNDOFF * joints[j, SPEED]
                jump = abs(coefficients[i + 1, j, 0] - ends[j, VALUE]) + ends[j, ROUNDING]
                table[i, j, VALUE_JUMP] = (
                    jump + table[i, j, FASTEST] * 16.0 * UNIT_ROUNDOFF * length
                )
                table[i, j, VELOCITY_JUMP] = abs(rate - ends[j, RATE]) + rounded


@kernel(allocates=False)
def piece_length(breaks: Array, i: int) -> float:
    """Length of piece i [s]; the difference is rounded, a little more of it does no harm."""
    return float((breaks[i + 1] - breaks[i]) * (1.0 + 4.0 * UNIT_ROUNDOFF))


@kernel(allocates=False)
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
        speed, acceleration, rounded, jumps, rate_jumps = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(first, last + 1):
            low, high = min(low, table[i, j, LOWEST]), max(high, table[i, j, HIGHEST])
            speed = max(speed, table[i, j, FASTEST])
            acceleration = max(acceleration, table[i, j, MAX_ACCELERATION])
            rounded = max(rounded, table[i, j, PIECE_ROUNDING])
            if i < last:
                jumps += table[i, j, VALUE_JUMP]
                rate_jumps += table[i, j, VELOCITY_JUMP]
        rounded += jumps + rate_jumps * 2.0 * half
        joints[j, VALUE] = value
        joints[j, RADIUS] = (max(high - value, value - low) + rounded) * OUTWARD
        joints[j, RATE] = coefficients[middle, j, 1] if k > 1 else 0.0
        joints[j, SPEED] = (speed + rate_jumps) * OUTWARD
        joints[j, ACCELERATION] = acceleration * OUTWARD
        joints[j, ROUNDING] = rounded * OUTWARD


@kernel(allocates=False)
def place(
    joint: int, i: int, frames: Array, own: Array, middles: Array, poses: Array, centers: Array
) -> None:
    """Write the pose (4, 4) and the ball's centre (3,) of element i in the base frame.

    Args:
        joint: The joint that carries it, -1 for none.
        i: The element.
        frames: T_base_joint, shape (n, 4, 4).
        own: Poses of the elements in the frames of their joints, shape (e, 4, 4).
        middles: Centres of their balls in the frames of their joints, shape (e, 3) [m].
        poses: Filled at i, shape (e, 4, 4).
        centers: Filled at i, shape (e, 3) [m].
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


@kernel(allocates=False)
def displacement_bounds(
    types: Indices,
    frames: Array,
    center: Vector,
    radius: float,
    carrier: int,
    joints: Array,
    half: float,
    moves: Array,
) -> None:
    """Bound how a ball carried by a joint moves on an interval, seen from every body before it.

    Args:
        types: Of the joints, shape (n,).
        frames: T_base_joint in the middle of the interval, shape (n, 4, 4).
        center: Of the ball in the base frame [m].
        radius: Of the ball [m].
        carrier: The joint it moves with.
        joints: From ``enclose``, shape (n, JOINT_COLUMNS).
        half: Half the interval's length [s].
        moves: Row k is filled for joints k .. carrier moving, columns MOVED to TURN,
            shape (n, MOVE_COLUMNS).
    """
    x, y, z = center
    far, speed, acceleration, rounded = 0.0, 0.0, 0.0, 0.0
    vx, vy, vz, wx, wy, wz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(carrier, -1, -1):
        rate = joints[j, RATE]
        ax, ay, az = frames[j, 0, 2], frames[j, 1, 2], frames[j, 2, 2]
        if types[j] == 1:
            far += joints[j, RADIUS]
            speed += joints[j, SPEED]
            acceleration += joints[j, ACCELERATION]
            rounded += joints[j, ROUNDING]
            vx, vy, vz = vx + rate * ax, vy + rate * ay, vz + rate * az
        else:
            dx, dy, dz = x - frames[j, 0, 3], y - frames[j, 1, 3], z - frames[j, 2, 3]
            cx, cy, cz = ay * dz - az * dy, az * dx - ax * dz, ax * dy - ay * dx
            # Distance of any point of the ball from the axis, wherever the joints behind it are.
            lever = math.sqrt(cx * cx + cy * cy + cz * cz) + radius + far
            # Seen from the body before: centripetal, and twice the turn times what moves in it.
            turn = joints[j, SPEED]
            acceleration += (joints[j, ACCELERATION] + turn * turn) * lever + 2.0 * turn * speed
            speed += turn * lever
            rounded += joints[j, ROUNDING] * lever
            # No point is displaced by more than the circle's diameter.
            far += min(lever * joints[j, RADIUS], 2.0 * lever)
            vx, vy, vz = vx + rate * cx, vy + rate * cy, vz + rate * cz
            wx, wy, wz = wx + rate * ax, wy + rate * ay, wz + rate * az
        # The last term is what sums of the velocity's products can have rounded off.
        bend = 0.5 * acceleration * half * half + rounded + _CANCELLED * speed * half
        first = math.sqrt(vx * vx + vy * vy + vz * vz)
        first += radius * math.sqrt(wx * wx + wy * wy + wz * wz)
        moves[j, MOVED] = min(far, first * half + bend) * OUTWARD
        moves[j, BEND] = bend
        moves[j, VELOCITY], moves[j, VELOCITY + 1], moves[j, VELOCITY + 2] = vx, vy, vz
        moves[j, TURN], moves[j, TURN + 1], moves[j, TURN + 2] = wx, wy, wz


@kernel(allocates=False)
def displacement_along(moves: Array, j: int, radius: float, half: float, u: Vector) -> float:
    """Displacement bound of a ball's points along a unit direction, seen from before joint j [m].

    Args:
        moves: From ``displacement_bounds``, shape (n, MOVE_COLUMNS).
        j: The first joint that moves.
        radius: Of the ball [m].
        half: Half the interval's length [s].
        u: The direction.
    """
    x, y, z = u
    first = x * moves[j, VELOCITY] + y * moves[j, VELOCITY + 1] + z * moves[j, VELOCITY + 2]
    wx, wy, wz = moves[j, TURN], moves[j, TURN + 1], moves[j, TURN + 2]
    a, b, c = y * wz - z * wy, z * wx - x * wz, x * wy - y * wx
    turned = radius * math.sqrt(a * a + b * b + c * c)
    moved = ((abs(first) + turned) * half + moves[j, BEND]) * OUTWARD
    return float(min(moves[j, MOVED], moved))


@kernel(allocates=False)
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


@kernel(allocates=False)
def reach(types: Indices, offsets: Array, joints: Array) -> float:
    """Size of the largest numbers that the joints' frames are summed from on an interval [m]."""
    total = 0.0
    for j in range(offsets.shape[0]):
        x, y, z = offsets[j, 0, 3], offsets[j, 1, 3], offsets[j, 2, 3]
        total += math.sqrt(x * x + y * y + z * z)
        if types[j] == 1:
            total += abs(joints[j, VALUE]) + joints[j, RADIUS]
    return total
