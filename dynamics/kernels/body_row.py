"""Columns of a body's row in ``Bodies.rows``, as the kernels of the dynamics read them.

A row begins like a joint's row in ``Chain.model``, so that one forward kinematics serves both.
"""

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import Vector
from kinematics.arrays import Array
from kinematics.model.chain import JointType

#: A ``JointType``.
TYPE = 0
#: The type of a revolute joint, as kernels compare it.
REVOLUTE = int(JointType.REVOLUTE)
#: First of the twelve numbers of the joint's frame at q = 0 in the frame before it: three rows.
FRAME = 1
#: Mass of the body [kg]: the first of its ten standard parameters.
MASS = 13
#: First of three: the first moment m c about the origin of the joint's frame [kg m].
FIRST_MOMENT = 14
#: First of six: xx, xy, yy, xz, yz, zz of the inertia about that origin [kg m^2].
INERTIA = 17
#: Inertia of the motor, reflected at the joint [kg m^2 or kg].
MOTOR = 23
#: Viscous friction [N m s/rad or N s/m].
FRICTION = 24
#: Dry friction [N m or N]. In the last row, which is gravity's: 1 if any joint has some, else 0.
COULOMB = 25
#: Columns of a row.
ROW = 26
#: Speed at which dry friction is tanh(1) = 76 % of its value [rad/s or m/s]: it is smoothed to
#: F tanh(q_dot / v), so that the equations of motion have one solution, and is F within 0.1 % from
#: four times that speed on.
SMOOTH_SPEED = 1e-2


@kernel(fastmath=True, allocates=False)
def origin(row: Array) -> Vector:
    """The joint's origin in the frame before it, at q = 0."""
    return row[4], row[8], row[12]


@kernel(fastmath=True, allocates=False)
def axis(row: Array) -> Vector:
    """The joint's z axis in the frame before it."""
    return row[3], row[7], row[11]


@kernel(fastmath=True, allocates=False)
def to_parent(row: Array, c: float, s: float, a: Vector) -> Vector:
    """A vector from the frame of a joint, turned by the angle of cosine c, in its parent's."""
    x, y, z = c * a[0] - s * a[1], s * a[0] + c * a[1], a[2]
    return (
        row[1] * x + row[2] * y + row[3] * z,
        row[5] * x + row[6] * y + row[7] * z,
        row[9] * x + row[10] * y + row[11] * z,
    )


@kernel(fastmath=True, allocates=False)
def to_child(row: Array, c: float, s: float, a: Vector) -> Vector:
    """A vector from the frame of the parent in that of a joint."""
    x = row[1] * a[0] + row[5] * a[1] + row[9] * a[2]
    y = row[2] * a[0] + row[6] * a[1] + row[10] * a[2]
    z = row[3] * a[0] + row[7] * a[1] + row[11] * a[2]
    return c * x + s * y, c * y - s * x, z


@kernel(fastmath=True, allocates=False)
def times_inertia(row: Array, a: Vector) -> Vector:
    """The product I a with the inertia of a body about its joint's origin."""
    xx, xy, yy = row[INERTIA], row[INERTIA + 1], row[INERTIA + 2]
    xz, yz, zz = row[INERTIA + 3], row[INERTIA + 4], row[INERTIA + 5]
    return (
        xx * a[0] + xy * a[1] + xz * a[2],
        xy * a[0] + yy * a[1] + yz * a[2],
        xz * a[0] + yz * a[1] + zz * a[2],
    )


@kernel(allocates=False)
def dry_friction(coulomb: float, qd: float) -> float:
    """Dry friction of a joint that moves at q_dot: F tanh(q_dot / v)."""
    return float(coulomb * np.tanh(qd / SMOOTH_SPEED))
