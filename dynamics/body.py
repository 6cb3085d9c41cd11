"""The rigid bodies of a chain: every link that a joint carries, merged into one body a joint."""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.chain import Array, Chain, Inertia, Link, frozen
from kinematics.errors import InvalidOption, MissingInertia


class Bodies(NamedTuple):
    """Everything the dynamics kernels read, packed (n joints, body i moves with joint i).

    A named tuple because numba takes one as a single argument.

    Args:
        types: Joint types, shape (n,).
        offsets: Frame of joint i in the frame of joint i-1, shape (n, 4, 4).
        masses: Shape (n,) [kg].
        centers: Centres of mass in the joint frames, shape (n, 3) [m].
        tensors: Inertia about the centres of mass in the axes of the joint frames,
            shape (n, 3, 3) [kg m^2].
        motor_inertia: Reflected at each joint, shape (n,) [kg m^2 or kg].
        viscous_friction: At each joint, shape (n,) [N m s/rad or N s/m].
        gravity: In the base frame, shape (3,) [m/s^2].
    """

    types: NDArray[np.int64]
    offsets: Array
    masses: Array
    centers: Array
    tensors: Array
    motor_inertia: Array
    viscous_friction: Array
    gravity: Array


def bodies(chain: Chain, gravity: ArrayLike | None = None) -> Bodies:
    """The bodies of ``chain``, under ``gravity`` (3,) [m/s^2] instead of its own where given.

    A link without inertia that is fixed to one that has it is a mere frame and adds nothing.

    Raises:
        MissingInertia: No link that some joint carries has an inertia; the message names them.
        InvalidOption: Gravity is not three finite numbers.
    """
    packed = _packed(chain)
    if gravity is None:
        return packed
    g = np.array(gravity, dtype=np.float64)
    if g.shape != (3,) or not np.isfinite(g).all():
        raise InvalidOption("gravity must be three finite numbers [x, y, z] in the base frame")
    return packed._replace(gravity=frozen(g))


def scale_masses(chain: Chain, factors: ArrayLike) -> Chain:
    """The same robot with the mass and inertia tensor of each body times a factor.

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
    return replace(chain, links=tuple(_scaled(link, each) for link in chain.links))


@lru_cache(maxsize=64)
def _packed(chain: Chain) -> Bodies:
    merged = [_merge(chain, i) for i in range(chain.n)]
    return Bodies(
        chain.joint_types,
        chain.offsets,
        frozen([body.mass for body in merged]),
        frozen([body.center_of_mass for body in merged]),
        frozen([body.tensor for body in merged]),
        chain.motor_inertia,
        chain.viscous_friction,
        chain.gravity,
    )


def _merge(chain: Chain, joint: int) -> Inertia:
    carried = [link for link in chain.links if link.joint == joint]
    parts = [_in_joint_frame(link, link.inertia) for link in carried if link.inertia is not None]
    if not parts:
        names = [link.name for link in carried]
        raise MissingInertia(
            f"nothing that joint {chain.joint_names[joint]!r} carries has an inertia "
            f"(link(s): {', '.join(names) or 'none'})",
            hint="Give at least one of them a mass, centre of mass and inertia tensor.",
            joint=chain.joint_names[joint],
            links=names,
        )
    masses = np.array([part.mass for part in parts])
    mass = float(masses.sum())
    # Bodies without mass (motor rotors given as inertia alone) have their centre where they say.
    weights = masses / mass if mass > 0.0 else np.full(len(parts), 1.0 / len(parts))
    center = weights @ np.array([part.center_of_mass for part in parts])
    tensors = [part.tensor + _point_tensor(part, center) for part in parts]
    return Inertia(mass, center, np.sum(tensors, axis=0))


def _in_joint_frame(link: Link, inertia: Inertia) -> Inertia:
    R, p = link.T_joint_link[:3, :3], link.T_joint_link[:3, 3]
    return Inertia(inertia.mass, R @ inertia.center_of_mass + p, R @ inertia.tensor @ R.T)


def _point_tensor(part: Inertia, center: Array) -> Array:
    """Parallel axis theorem: m (|d|^2 I - d d^T)."""
    d = part.center_of_mass - center
    return np.asarray(part.mass * (d @ d * np.eye(3) - np.outer(d, d)))


def _scaled(link: Link, factors: Array) -> Link:
    if link.joint < 0 or link.inertia is None:
        return link
    factor = float(factors[link.joint])
    body = link.inertia
    return replace(
        link, inertia=Inertia(factor * body.mass, body.center_of_mass, factor * body.tensor)
    )
