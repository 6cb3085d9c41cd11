"""Bounds of the motion of one link seen from another, over an interval of time.

Seen from the reference a point x that another link carries obeys, with s the time from the middle
of the interval of half length h, v the velocity there and a the largest acceleration,

    |x(s) - x(0) - s v| <= a h^2 / 2,

and a direction A of that link the same with w x A for v. Joint by joint from the point towards the
reference, rho_j + D the largest distance of the point from axis j, V_j and A_j the largest rate and
acceleration of the joint:

    a <- a + (A_j + V_j^2) (rho_j + D) + 2 V_j |v|,    |v| <- |v| + V_j (rho_j + D)    (revolute)
    a <- a + A_j,                                      |v| <- |v| + V_j               (prismatic)

and the angular acceleration is at most sum_j A_j + sum_(i < j) V_i V_j over the revolute joints.
The bounds of single joints are those of ``motion_bounds.enclose``; what rounding can have done is
part of all bounds.
"""

import math
from typing import NamedTuple

from compiled.kernel import kernel
from compiled.vec3 import Vector, cross, dot
from kinematics.arrays import Array, Indices
from planning.proof.motion_bounds import ACCELERATION, OUTWARD, RADIUS, RATE, ROUNDING, SPEED

#: What a sum of products that cancel may have lost of the sum of their sizes [relative].
_CANCELLED = 1e-12


class RelativeMotion(NamedTuple):
    """Bounds of a point's motion, and of its link's turning, seen from a reference link.

    Args:
        velocity: Velocity of the point in the middle of the interval, in the base's axes [m/s].
        turn_rate: Angular velocity there, in the base's axes [rad/s].
        moved: How far the point moves at most [m].
        bend: How far it is off ``velocity`` times the time at most [m].
        acceleration: Largest acceleration of the point [m/s^2].
        turned: How far the link turns at most [rad].
        turn_bend: How far that is off ``turn_rate`` times the time at most, to first order [rad].
        turn_speed: Largest angular speed [rad/s].
        turn_acceleration: Largest angular acceleration [rad/s^2].
    """

    velocity: Vector
    turn_rate: Vector
    moved: float
    bend: float
    acceleration: float
    turned: float
    turn_bend: float
    turn_speed: float
    turn_acceleration: float


@kernel(allocates=False)
def relative_motion(
    types: Indices,
    frames: Array,
    point: Vector,
    carrier: int,
    reference: int,
    joints: Array,
    half: float,
) -> RelativeMotion:
    """Bound the motion of a point of one link seen from another.

    Args:
        types: Types of the joints, shape (n,).
        frames: T_base_joint in the middle of the interval, shape (n, 4, 4).
        point: Place of the point, in the base frame [m].
        carrier: The joint that carries the point, -1 for the base.
        reference: The joint whose link it is seen from, -1 for the base.
        joints: Joints from ``enclose``, shape (n, JOINT_COLUMNS).
        half: Half the interval's length [s].
    """
    first, last = min(carrier, reference) + 1, max(carrier, reference)
    outwards = carrier > reference
    sign = 1.0 if outwards else -1.0
    far, speed, acceleration, rounded = 0.0, 0.0, 0.0, 0.0
    turned, turn_speed, turn_acceleration, turn_rounded = 0.0, 0.0, 0.0, 0.0
    vx, vy, vz, wx, wy, wz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for step in range(last - first + 1):
        j = last - step if outwards else first + step
        rate = sign * joints[j, RATE]
        fastest, steepest = joints[j, SPEED], joints[j, ACCELERATION]
        z = (frames[j, 0, 2], frames[j, 1, 2], frames[j, 2, 2])
        if types[j] == 1:
            far += joints[j, RADIUS]
            speed += fastest
            acceleration += steepest
            rounded += joints[j, ROUNDING]
            vx, vy, vz = vx + rate * z[0], vy + rate * z[1], vz + rate * z[2]
            continue
        d = (point[0] - frames[j, 0, 3], point[1] - frames[j, 1, 3], point[2] - frames[j, 2, 3])
        arm = cross(z, d)
        lever = math.sqrt(dot(arm, arm)) + far
        acceleration += (steepest + fastest * fastest) * lever + 2.0 * fastest * speed
        speed += fastest * lever
        rounded += joints[j, ROUNDING] * lever
        far += min(lever * joints[j, RADIUS], 2.0 * lever)
        vx, vy, vz = vx + rate * arm[0], vy + rate * arm[1], vz + rate * arm[2]
        turn_acceleration += steepest + fastest * turn_speed
        turn_speed += fastest
        turned += joints[j, RADIUS]
        turn_rounded += joints[j, ROUNDING]
        wx, wy, wz = wx + rate * z[0], wy + rate * z[1], wz + rate * z[2]
    bend = 0.5 * acceleration * half * half + rounded + _CANCELLED * speed * half
    turn_bend = 0.5 * turn_acceleration * half * half
    turn_bend += turn_rounded + _CANCELLED * turn_speed * half
    moved = min(far, math.sqrt(vx * vx + vy * vy + vz * vz) * half + bend)
    turned = min(turned, math.sqrt(wx * wx + wy * wy + wz * wz) * half + turn_bend)
    return RelativeMotion(
        (vx, vy, vz),
        (wx, wy, wz),
        moved * OUTWARD,
        bend * OUTWARD,
        acceleration * OUTWARD,
        turned * OUTWARD,
        turn_bend * OUTWARD,
        turn_speed * OUTWARD,
        turn_acceleration * OUTWARD,
    )


@kernel(allocates=False)
def axis_motion(
    types: Indices,
    frames: Array,
    axis: Vector,
    carrier: int,
    reference: int,
    joints: Array,
    half: float,
) -> tuple[float, float]:
    """Bound the motion of a unit vector of one link on the unit sphere, seen from another link.

    A joint along which the vector points does not move it.

    Args:
        types: Types of the joints, shape (n,).
        frames: T_base_joint in the middle of the interval, shape (n, 4, 4).
        axis: The vector there, in the base's axes.
        carrier: The joint that carries it, -1 for the base.
        reference: The joint whose link it is seen from, -1 for the base.
        joints: Joints from ``enclose``, shape (n, JOINT_COLUMNS).
        half: Half the interval's length [s].

    Returns:
        How far it moves at most, and how far it is off its velocity times the time.
    """
    first, last = min(carrier, reference) + 1, max(carrier, reference)
    outwards = carrier > reference
    far, speed, acceleration, rounded = 0.0, 0.0, 0.0, 0.0
    for step in range(last - first + 1):
        j = last - step if outwards else first + step
        if types[j] == 1:
            continue
        fastest = joints[j, SPEED]
        arm = cross((frames[j, 0, 2], frames[j, 1, 2], frames[j, 2, 2]), axis)
        lever = min(math.sqrt(dot(arm, arm)) + far, 1.0)
        acceleration += (joints[j, ACCELERATION] + fastest * fastest) * lever
        acceleration += 2.0 * fastest * speed
        speed += fastest * lever
        rounded += joints[j, ROUNDING] * lever
        far = min(far + lever * joints[j, RADIUS], 2.0)
    bend = 0.5 * acceleration * half * half + rounded + _CANCELLED * speed * half
    return far * OUTWARD, bend * OUTWARD
