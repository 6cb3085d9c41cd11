"""Gravity: the potential energy U(q) and the torques G(q) that hold the robot against it."""

import numpy as np
from numpy.typing import ArrayLike

from compiled.kernel import kernel
from dynamics.kernels.recursion import WORK, gravity_kernel
from dynamics.model.body import bodies
from kinematics.arrays import Array
from kinematics.forward import joint_frames
from kinematics.model.chain import Chain


@kernel
def gravity_batch_kernel(rows: Array, q: Array, G: Array) -> None:
    """Write G(q) of a batch q (m, n) into G (m, n)."""
    work = np.empty((q.shape[1], WORK))
    for k in range(q.shape[0]):
        gravity_kernel(rows, q[k], work, G[k])


def gravity_vector(chain: Chain, q: ArrayLike, gravity: ArrayLike | None = None) -> Array:
    """Torques G(q) = grad U(q) that hold the robot still against gravity.

    Args:
        chain: The robot.
        q: One configuration (n,) or a batch (..., n) [rad or m].
        gravity: (3,) [m/s^2] in the base frame; the robot's own where none is given.

    Returns:
        Shape (..., n) [N m or N].

    Raises:
        InvalidRobotState: Wrong length or not finite.
        MissingInertia: No link that a joint carries has an inertia.
    """
    packed = bodies(chain, gravity)
    q = chain.configuration(q)
    flat = q.reshape(-1, chain.n)
    G = np.empty((flat.shape[0], chain.n))
    gravity_batch_kernel(packed.rows, flat, G)
    return G.reshape(*q.shape[:-1], chain.n)


def potential_energy(chain: Chain, q: ArrayLike, gravity: ArrayLike | None = None) -> Array:
    """Potential energy U(q) = -sum_i m_i g . r_i(q) of the moving bodies, shape (...) [J].

    Zero where a body's centre of mass is level with the origin of the base frame.

    Raises:
        InvalidRobotState: Wrong length or not finite.
        MissingInertia: No link that a joint carries has an inertia.
    """
    packed = bodies(chain, gravity)
    frames = joint_frames(chain, q)
    centers = frames[..., :3, 3] + np.einsum(
        "...nij,nj->...ni", frames[..., :3, :3], packed.centers
    )
    return np.asarray(-np.einsum("n,...ni,i->...", packed.masses, centers, packed.gravity))
