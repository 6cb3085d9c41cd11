"""Energies of a moving robot; the potential energy is in ``dynamics.gravity``."""

import numpy as np
from numpy.typing import ArrayLike

from dynamics.batch import stack_vectors
from dynamics.gravity import potential_energy
from dynamics.mass_matrix import augmented_mass_matrix
from kinematics.arrays import Array
from kinematics.model.chain import Chain


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


def total_energy(
    chain: Chain, q: ArrayLike, qd: ArrayLike, gravity: ArrayLike | None = None
) -> Array:
    """Total energy T + U, shape (...) [J]: constant without torques and friction.

    Raises:
        InvalidRobotState: A vector has the wrong length, is not finite or fits no other's batch.
        MissingInertia: No link that a joint carries has an inertia.
    """
    return kinetic_energy(chain, q, qd) + potential_energy(chain, q, gravity)
