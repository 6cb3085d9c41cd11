"""Terms of the equations of motion: D(q), C(q, q_dot), G(q), energies and partial Jacobians."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from compiled.kernel import kernel
from dynamics.kernels.composite import (
    COMPOSITE_WORK,
    coriolis_kernel,
    frames_kernel,
    mass_matrix_kernel,
)
from dynamics.kernels.recursion import WORK, gravity_kernel
from dynamics.model.body import bodies
from kinematics.arrays import Array
from kinematics.forward import joint_frames
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain, stack_vectors
from kinematics.pose import inverse


@kernel
def mass_matrix_batch_kernel(rows: Array, q: Array, D: Array) -> None:
    """Write D(q) of a batch q (m, n) into D (m, n, n)."""
    work = np.empty((q.shape[1], COMPOSITE_WORK))
    for k in range(q.shape[0]):
        frames_kernel(rows, q[k], work)
        mass_matrix_kernel(rows, work, D[k])


def mass_matrix(chain: Chain, q: ArrayLike) -> Array:
    """Mass matrix D(q) = sum_i m_i J_vi^T J_vi + J_wi^T R_i I_i R_i^T J_wi, without the motors.

    Composite rigid body algorithm ("Efficient dynamic computer simulation of robotic
    mechanisms").

    Args:
        chain: The robot.
        q: One configuration (n,) or a batch (..., n) [rad or m].

    Returns:
        Symmetric, shape (..., n, n) [kg m^2, kg m or kg].

    Raises:
        InvalidRobotState: Wrong length or not finite.
        MissingInertia: No link that a joint carries has an inertia.
    """
    q = chain.configuration(q)
    flat = q.reshape(-1, chain.n)
    D = np.empty((flat.shape[0], chain.n, chain.n))
    mass_matrix_batch_kernel(bodies(chain).rows, flat, D)
    return D.reshape(*q.shape[:-1], chain.n, chain.n)


def augmented_mass_matrix(chain: Chain, q: ArrayLike) -> Array:
    """M(q) = D(q) + J with J = diag(motor inertia reflected at the joints), shape (..., n, n).

    Raises:
        InvalidRobotState: Wrong length or not finite.
        MissingInertia: No link that a joint carries has an inertia.
    """
    return mass_matrix(chain, q) + np.diag(chain.motor_inertia)


class PartialJacobians(NamedTuple):
    """Jacobians of all bodies, body i moving with joint i, in the base frame.

    Args:
        linear: J_vi with dr_i/dt = J_vi q_dot of the centre of mass r_i, shape (..., n, 3, n).
        angular: J_wi with w_i = J_wi q_dot, shape (..., n, 3, n).
    """

    linear: Array
    angular: Array


def partial_jacobians(chain: Chain, q: ArrayLike) -> PartialJacobians:
    """Partial Jacobians J_vi, J_wi of D = sum_i m_i J_vi^T J_vi + J_wi^T R_i I_i R_i^T J_wi.

    Args:
        chain: The robot.
        q: Positions, (n,) or (..., n) [rad or m].

    Raises:
        InvalidRobotState: q has the wrong length or is not finite.
        MissingInertia: No link that a joint carries has an inertia.
    """
    packed = bodies(chain)
    carried = {link.joint: link for link in chain.links}
    rows = []
    for joint in range(chain.n):
        link = carried[joint]
        T_link_joint = inverse(link.T_joint_link)
        center = T_link_joint[:3, :3] @ packed.centers[joint] + T_link_joint[:3, 3]
        rows.append(geometric(chain, q, link.name, center))
    J = np.stack(rows, axis=-3)
    return PartialJacobians(J[..., :3, :], J[..., 3:, :])


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


def kinetic_energy(chain: Chain, q: ArrayLike, qd: ArrayLike) -> Array:
    """Kinetic energy T = q_dot^T M(q) q_dot / 2 with the motors' part, shape (...) [J].

    Raises:
        InvalidRobotState: A vector has the wrong length, is not finite or fits no other's batch.
        MissingInertia: No link that a joint carries has an inertia.
    """
    state, lead = stack_vectors(chain, joints=q, velocities=qd)
    M = augmented_mass_matrix(chain, state[:, 0])
    T = 0.5 * np.einsum("mi,mij,mj->m", state[:, 1], M, state[:, 1])
    return np.asarray(T.reshape(lead))
