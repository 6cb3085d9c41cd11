"""The mass matrix D(q), and M(q) = D(q) + J with the motors."""

import numpy as np
from numpy.typing import ArrayLike

from compiled.kernel import kernel
from dynamics.inverse import reference_dynamics
from dynamics.kernels.composite import COMPOSITE_WORK, frames_kernel, mass_matrix_kernel
from dynamics.model.body import bodies
from kinematics.arrays import Array
from kinematics.model.chain import Chain


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


def kinetic_rate(chain: Chain, q: Array, qd: Array, r: Array, r_dot: Array) -> float:
    """The rate of r^T M(q) r / 2 along a motion, r^T (M r_dot + C r), as M_dot = C + C^T.

    Args:
        chain: The robot.
        q: Positions, shape (n,) [rad or m].
        qd: Velocities, shape (n,) [rad/s or m/s].
        r: Any velocity of the joints, shape (n,) [rad/s or m/s].
        r_dot: Time derivative of r, shape (n,) [rad/s^2 or m/s^2].

    Raises:
        InvalidRobotState: A vector has the wrong length or is not finite.
        MissingInertia: Some joint carries nothing that has an inertia.
    """
    zero = np.zeros(chain.n)
    # Gravity and friction, which do not depend on r, drop out.
    whole = reference_dynamics(chain, q, qd, r, r_dot)
    return float(r @ (whole - reference_dynamics(chain, q, qd, zero, zero)))
