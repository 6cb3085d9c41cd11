"""The Coriolis matrix C(q, q_dot) of the Christoffel symbols, exact."""

import numpy as np
from numpy.typing import ArrayLike

from compiled.kernel import kernel
from dynamics.batch import stack_vectors
from dynamics.kernels.composite import COMPOSITE_WORK, coriolis_kernel, frames_kernel
from dynamics.model.body import bodies
from kinematics.arrays import Array
from kinematics.model.chain import Chain


@kernel
def coriolis_batch_kernel(rows: Array, state: Array, C: Array) -> None:
    """Write C(q, q_dot) of a batch, state (m, 2, n), into C (m, n, n)."""
    work = np.empty((state.shape[2], COMPOSITE_WORK))
    for k in range(state.shape[0]):
        frames_kernel(rows, state[k, 0], work)
        coriolis_kernel(rows, state[k, 1], work, C[k])


def coriolis_matrix(chain: Chain, q: ArrayLike, qd: ArrayLike) -> Array:
    """Coriolis matrix C_kj = sum_i c_ijk q_dot_i of the Christoffel symbols of D.

    c_ijk = (d_kj,i + d_ki,j - d_ij,k) / 2, so D_dot - 2 C is skew-symmetric.

    Args:
        chain: The robot.
        q: Positions, (n,) or (..., n) [rad or m].
        qd: Velocities, (n,) or (..., n) [rad/s or m/s].

    Returns:
        Shape (..., n, n).

    Raises:
        InvalidRobotState: A vector has the wrong length, is not finite or fits no other's batch.
        MissingInertia: No link that a joint carries has an inertia.
    """
    packed = bodies(chain)
    state, lead = stack_vectors(chain, joints=q, velocities=qd)
    C = np.empty((state.shape[0], chain.n, chain.n))
    coriolis_batch_kernel(packed.rows, state, C)
    return C.reshape(*lead, chain.n, chain.n)


def christoffel_symbols(chain: Chain, q: ArrayLike) -> Array:
    """Christoffel symbols c_ijk = (d_kj,i + d_ki,j - d_ij,k) / 2 of the mass matrix D, exact.

    C is linear in the velocities, so c_ijk is C_kj at the velocity e_i. c_ijk = c_jik.

    Args:
        chain: The robot.
        q: Positions, (n,) or (..., n) [rad or m].

    Returns:
        Shape (..., n, n, n), indices i, j, k.

    Raises:
        InvalidRobotState: q has the wrong length or is not finite.
        MissingInertia: No link that a joint carries has an inertia.
    """
    q = chain.configuration(q)
    each = np.repeat(q[..., None, :], chain.n, axis=-2)
    rates = np.broadcast_to(np.eye(chain.n), each.shape)
    return np.asarray(np.swapaxes(coriolis_matrix(chain, each, rates), -1, -2))
