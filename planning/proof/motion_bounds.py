"""Bounds of the joints' motion over an interval of time, and places of the solids they carry.

On an interval [m - h, m + h] of time a joint is q(m + s) = c_0 + c_1 s + ..., its coefficients
found by Taylor's shift. Written apart from the planner's own kernels on purpose: a fault there must
not be believed here. What rounding can have done to any number is part of its bound.
"""

import math

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices

#: Unit of rounding [relative].
UNIT_ROUNDOFF = 2.0**-53
#: What sums of products of bounds may have lost themselves [relative].
OUTWARD = 1.0 + 1e-12

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
#: Its acceleration in the middle [rad/s^2 or m/s^2].
BOW = 6
#: Its largest absolute jerk in the interval, infinite where its acceleration jumps.
JERK = 7
#: How far the true motion may be from value, rate and BOW as they are told [rad or m].
BOW_ROUNDING = 8
JOINT_COLUMNS = 9

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
#: Largest absolute jerk [rad/s^3 or m/s^3].
MAX_JERK = 7
#: What the next piece jumps by in acceleration [rad/s^2 or m/s^2].
ACCELERATION_JUMP = 8
PIECE_COLUMNS = 9

# Rows of what says how bodies hang on each other: first those of the chain's joints, then those on
# joints that follow them; a body hangs on one of a smaller number.
#: Type of the joint that moves a body, 0 revolute, 1 prismatic.
TYPE = 0
#: The body before it, -1 for the base.
PARENT = 1

#: Jumps of acceleration that are rounding, as a share of the largest acceleration.
_SMOOTH = 1e-6


@kernel(allocates=False)
def enclose(coefficients: Array, at: float, half: float, scratch: Array, joints: Array) -> None:
    """Enclose one piece of a trajectory on an interval.

    Args:
        coefficients: Coefficients of the piece, in ascending powers of its own time, shape (n, k).
        at: The interval's middle in the piece's own time, 0 or more [s].
        half: Half the interval's length [s].
        scratch: Shape (2, k).
        joints: Filled, columns VALUE to BOW_ROUNDING, shape (n, JOINT_COLUMNS).
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
        radius, speed, acceleration, jerk = 0.0, 0.0, 0.0, 0.0
        power, lower_power, least_power = 1.0, 0.0, 0.0
        for i in range(1, k):
            largest = abs(c[i]) + unit * size[i]
            radius += largest * power * half
            speed += i * largest * power
            acceleration += i * (i - 1) * largest * lower_power
            jerk += i * (i - 1) * (i - 2) * largest * least_power
            least_power, lower_power, power = lower_power, power, power * half
        joints[j, VALUE] = c[0]
        joints[j, RADIUS] = (radius + rounded) * OUTWARD
        joints[j, RATE] = rate
        joints[j, SPEED] = speed * OUTWARD
        joints[j, ACCELERATION] = acceleration * OUTWARD
        rounded += unit * (size[1] * half if k > 1 else 0.0)
        joints[j, ROUNDING] = rounded * OUTWARD
        joints[j, BOW] = 2.0 * c[2] if k > 2 else 0.0
        joints[j, JERK] = jerk * OUTWARD
        rounded += unit * (size[2] * half * half if k > 2 else 0.0)
        joints[j, BOW_ROUNDING] = rounded * OUTWARD


@kernel(allocates=False)
def enclose_mimic_joints(leaders: Indices, leads: Array, joints: Array) -> None:
    """Enclose the joints that follow others: q = m q_j + b, so everything is |m| times as large.

    Args:
        leaders: The joint j that each of them follows, shape (f,).
        leads: Multiplier m and offset b of each, shape (f, 2).
        joints: Joints from ``enclose``, the last f rows filled, shape (n + f, JOINT_COLUMNS).
    """
    first = joints.shape[0] - leaders.shape[0]
    for k in range(leaders.shape[0]):
        row, j, m, b = first + k, leaders[k], leads[k, 0], leads[k, 1]
        size = abs(m)
        # A product and a sum are rounded.
        lost = 4.0 * UNIT_ROUNDOFF * (size * abs(joints[j, VALUE]) + abs(b))
        joints[row, VALUE] = m * joints[j, VALUE] + b
        joints[row, RADIUS] = (size * joints[j, RADIUS] + lost) * OUTWARD
        joints[row, RATE] = m * joints[j, RATE]
        joints[row, SPEED] = size * joints[j, SPEED] * OUTWARD
        joints[row, ACCELERATION] = size * joints[j, ACCELERATION] * OUTWARD
        joints[row, ROUNDING] = (size * joints[j, ROUNDING] + lost) * OUTWARD
        joints[row, BOW] = m * joints[j, BOW]
        joints[row, JERK] = size * joints[j, JERK] * OUTWARD
        joints[row, BOW_ROUNDING] = (size * joints[j, BOW_ROUNDING] + lost) * OUTWARD


@kernel
def piece_bounds(breaks: Array, coefficients: Array, table: Array) -> None:
    """Enclose every piece of a trajectory as a whole.

    Args:
        breaks: Shape (m + 1,) [s].
        coefficients: Shape (m, n, k).
        table: Filled, columns LOWEST to ACCELERATION_JUMP, shape (m, n, PIECE_COLUMNS).
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
            table[i, j, MAX_JERK] = joints[j, JERK]
            table[i, j, VALUE_JUMP], table[i, j, VELOCITY_JUMP] = 0.0, 0.0
            table[i, j, ACCELERATION_JUMP] = 0.0
            if i + 1 < m:
                rate = coefficients[i + 1, j, 1] if k > 1 else 0.0
                rounded = 2.0 * ends[j, ROUNDING] / length + 16.0 * UNIT_ROUNDOFF * joints[j, SPEED]
                jump = abs(coefficients[i + 1, j, 0] - ends[j, VALUE]) + ends[j, ROUNDING]
                table[i, j, VALUE_JUMP] = (
                    jump + table[i, j, FASTEST] * 16.0 * UNIT_ROUNDOFF * length
                )
                table[i, j, VELOCITY_JUMP] = abs(rate - ends[j, RATE]) + rounded
                bow = 2.0 * coefficients[i + 1, j, 2] if k > 2 else 0.0
                rounded = 2.0 * rounded / length + 16.0 * UNIT_ROUNDOFF * joints[j, ACCELERATION]
                table[i, j, ACCELERATION_JUMP] = abs(bow - ends[j, BOW]) + rounded


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
    rate are continuous, acceleration too where its jumps are rounding, and that one is enclosed.
    """
    n, k = coefficients.shape[1], coefficients.shape[2]
    for j in range(n):
        value = coefficients[middle, j, 0]
        low = high = value
        speed, acceleration, rounded, jumps, rate_jumps = 0.0, 0.0, 0.0, 0.0, 0.0
        jerk, bow_jumps = 0.0, 0.0
        for i in range(first, last + 1):
            low, high = min(low, table[i, j, LOWEST]), max(high, table[i, j, HIGHEST])
            speed = max(speed, table[i, j, FASTEST])
            acceleration = max(acceleration, table[i, j, MAX_ACCELERATION])
            jerk = max(jerk, table[i, j, MAX_JERK])
            rounded = max(rounded, table[i, j, PIECE_ROUNDING])
            if i < last:
                jumps += table[i, j, VALUE_JUMP]
                rate_jumps += table[i, j, VELOCITY_JUMP]
                bow_jumps += table[i, j, ACCELERATION_JUMP]
        rounded += jumps + rate_jumps * 2.0 * half
        joints[j, VALUE] = value
        joints[j, RADIUS] = (max(high - value, value - low) + rounded) * OUTWARD
        joints[j, RATE] = coefficients[middle, j, 1] if k > 1 else 0.0
        # Jumps of acceleration that are but rounding are spread over the span, others end there.
        smooth = bow_jumps <= _SMOOTH * acceleration
        if smooth:
            speed, acceleration = speed + bow_jumps * 2.0 * half, acceleration + bow_jumps
        joints[j, SPEED] = (speed + rate_jumps) * OUTWARD
        joints[j, ACCELERATION] = acceleration * OUTWARD
        joints[j, ROUNDING] = rounded * OUTWARD
        joints[j, BOW] = 2.0 * coefficients[middle, j, 2] if k > 2 else 0.0
        joints[j, JERK] = jerk * OUTWARD if smooth else np.inf
        joints[j, BOW_ROUNDING] = (rounded + bow_jumps * 2.0 * half * half) * OUTWARD


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
