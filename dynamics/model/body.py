"""The rigid bodies of a chain: every link that a joint carries, merged into one body a joint.

A body's row in ``Bodies.rows`` begins like a joint's row in ``Chain.model``, so that one forward
kinematics serves both.
"""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compiled.kernel import kernel
from compiled.vec3 import Vector
from kinematics.arrays import Array, frozen, numbers
from kinematics.errors import InvalidOption, MissingInertia
from kinematics.model.chain import Chain, Inertia, JointType, Link

#: A ``JointType``.
TYPE = 0
#: The type of a revolute joint, as kernels compare it.
REVOLUTE = int(JointType.REVOLUTE)
#: First of the twelve numbers of the joint's frame at q = 0 in the frame before it: three rows.
FRAME = 1
#: Columns of such a frame that are the joint's z axis and its origin.
Z_COLUMN, ORIGIN_COLUMN = 2, 3
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


class Bodies(NamedTuple):
    """Quantities that the dynamics read of a chain (n joints, body i moves with joint i).

    Args:
        types: Joint types, shape (n,).
        offsets: Frame of joint i in the frame of joint i-1, shape (n, 4, 4).
        masses: Shape (n,) [kg].
        centers: Centres of mass in the joint frames, shape (n, 3) [m].
        tensors: Inertia about the centres of mass in the axes of the joint frames,
            shape (n, 3, 3) [kg m^2].
        motor_inertia: Reflected at each joint, shape (n,) [kg m^2 or kg].
        viscous_friction: Viscous friction at each joint, shape (n,) [N m s/rad or N s/m].
        gravity: Gravity in the base frame, shape (3,) [m/s^2].
        rows: All of that once more in one array, shape (n + 1, ``ROW``), as the kernels read it.
            One array is cheaper to hand to compiled code than eight. Row i is joint i, its columns
            as in ``body_row``. Row n begins with gravity.
    """

    types: NDArray[np.int64]
    offsets: Array
    masses: Array
    centers: Array
    tensors: Array
    motor_inertia: Array
    viscous_friction: Array
    gravity: Array
    rows: Array


def bodies(chain: Chain, gravity: ArrayLike | None = None) -> Bodies:
    """The bodies of ``chain``, under ``gravity`` (3,) [m/s^2] instead of its own where given.

    A link without inertia that is fixed to one that has it is a mere frame and adds nothing. A
    joint none of whose links has one carries a massless body.

    Raises:
        MissingInertia: No link of any joint has an inertia; the message names the links.
        InvalidOption: Gravity is not three finite numbers.
    """
    packed = _pack_bodies(chain)
    if gravity is None:
        return packed
    g = numbers(gravity, "gravity in the base frame", (3,))
    rows = packed.rows.copy()
    rows[-1, :3] = g
    return packed._replace(gravity=frozen(g), rows=frozen(rows))


def scale_masses(chain: Chain, factors: ArrayLike) -> Chain:
    """Robot with the mass and inertia tensor of each body times a factor.

    Args:
        chain: The robot.
        factors: One positive factor, or one a joint, shape (n,).

    Raises:
        InvalidOption: A factor is not positive and finite, or their number is wrong.
    """
    values = np.array(factors, dtype=np.float64)
    if values.shape not in {(), (chain.n,)} or not (np.isfinite(values) & (values > 0)).all():
        raise InvalidOption(
            f"mass factors must be positive: one number, or {chain.n}, one for each joint",
            hint="1.0 leaves a body as it is; 1.2 makes it a fifth heavier.",
        )
    each = np.broadcast_to(values, (chain.n,))
    return replace(chain, links=tuple(_scale_link(link, each) for link in chain.links))


@lru_cache(maxsize=64)
def _pack_bodies(chain: Chain) -> Bodies:
    _check_inertias(chain)
    merged = [_merge(chain, i) for i in range(chain.n)]
    rows = np.zeros((chain.n + 1, ROW))
    for i, body in enumerate(merged):
        rows[i, TYPE] = chain.joint_types[i]
        rows[i, FRAME:MASS] = chain.offsets[i, :3].ravel()
        rows[i, MASS:MOTOR] = standard_parameters(body)
        rows[i, MOTOR] = chain.motor_inertia[i]
        rows[i, FRICTION] = chain.viscous_friction[i]
        rows[i, COULOMB] = chain.coulomb_friction[i]
    rows[-1, :3] = chain.gravity
    rows[-1, COULOMB] = np.any(rows[:-1, COULOMB])
    return Bodies(
        chain.joint_types,
        chain.offsets,
        frozen([body.mass for body in merged]),
        frozen([body.center_of_mass for body in merged]),
        frozen([body.tensor for body in merged]),
        chain.motor_inertia,
        chain.viscous_friction,
        chain.gravity,
        frozen(rows),
    )


def standard_parameters(body: Inertia) -> Array:
    """The ten parameters that a body's equations of motion are linear in, shape (10,).

    m; m c (3); then xx, xy, yy, xz, yz, zz of the inertia about the frame's origin,
    I + m (|c|^2 E - c c^T).
    """
    c = body.center_of_mass
    about = body.tensor + body.mass * (c @ c * np.eye(3) - np.outer(c, c))
    upper = [about[0, 0], about[0, 1], about[1, 1], about[0, 2], about[1, 2], about[2, 2]]
    return np.array([body.mass, *(body.mass * c), *upper])


def massless_joints(chain: Chain) -> tuple[int, ...]:
    """The joints none of whose own links has an inertia."""
    full = {link.joint for link in chain.links if link.inertia is not None}
    return tuple(i for i in range(chain.n) if i not in full)


def joints_without_inertia(chain: Chain) -> tuple[str, ...]:
    """Names of the joints that carry no inertia at all: no link, no later link, no motor.

    Torques do not determine their accelerations: the mass matrix has a zero row at each.

    Args:
        chain: The robot.
    """
    full = [link.joint for link in chain.links if link.joint >= 0 and link.inertia is not None]
    first = max(full, default=-1) + 1
    return tuple(chain.joint_names[i] for i in range(first, chain.n) if not chain.motor_inertia[i])


def _check_inertias(chain: Chain) -> None:
    """Refuse a chain none of whose moving links has an inertia, or with joints that follow others.

    Raises:
        MissingInertia: None has, or what mimic joints carry is not in the equations of motion.
    """
    if chain.mimic_joints:
        carrying = ", ".join(repr(mimic.name) for mimic in chain.mimic_joints)
        raise MissingInertia(
            f"the equations of motion of robot {chain.name!r} are not known: they leave out what "
            f"joint(s) {carrying} carry, which mimic joints of the chain",
            hint="Make these joints fixed in the description, or leave out what needs forces.",
            joints=[mimic.name for mimic in chain.mimic_joints],
            links=[],
        )
    if len(massless_joints(chain)) < chain.n:
        return
    names = [link.name for link in chain.links if link.joint >= 0]
    raise MissingInertia(
        f"the bodies that joint(s) {', '.join(map(repr, chain.joint_names))} carry have no inertia "
        f"(link(s): {', '.join(names) or 'none'})",
        hint="Give at least one link a mass, centre of mass and inertia tensor; links without "
        "them are massless.",
        joints=list(chain.joint_names),
        links=names,
    )


def _merge(chain: Chain, joint: int) -> Inertia:
    carried = [link for link in chain.links if link.joint == joint]
    return Inertia.merged([(k.inertia, k.T_joint_link) for k in carried if k.inertia is not None])


def _scale_link(link: Link, factors: Array) -> Link:
    if link.joint < 0 or link.inertia is None:
        return link
    factor = float(factors[link.joint])
    body = link.inertia
    return replace(
        link, inertia=Inertia(factor * body.mass, body.center_of_mass, factor * body.tensor)
    )


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


@kernel(allocates=False)
def dry_friction(coulomb: float, qd: float) -> float:
    """Dry friction of a joint that moves at q_dot: F tanh(q_dot / v)."""
    return float(coulomb * np.tanh(qd / SMOOTH_SPEED))


@kernel(fastmath=True, allocates=False)
def symmetric(U: Vector, T: Vector, a: Vector) -> Vector:
    """The product with a symmetric matrix of rows (U0, U1, T0), (U1, U2, T1), (T0, T1, T2).

    An inertia is U and T as a row has it from ``INERTIA`` on.
    """
    return (
        U[0] * a[0] + U[1] * a[1] + T[0] * a[2],
        U[1] * a[0] + U[2] * a[1] + T[1] * a[2],
        T[0] * a[0] + T[1] * a[1] + T[2] * a[2],
    )
