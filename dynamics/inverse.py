"""Inverse dynamics: motion to joint torques, by the recursive Newton-Euler algorithm."""

import numpy as np
from numpy.typing import ArrayLike

from compiled.kernel import kernel
from dynamics.kernels.recursion import WORK, inverse_kernel
from dynamics.model.body import bodies
from kinematics.arrays import Array
from kinematics.model.chain import Chain, stack_vectors
from kinematics.velocity import holding_torques


@kernel
def inverse_batch_kernel(rows: Array, motion: Array, torque: Array) -> None:
    """``inverse_kernel`` for a batch: motion (m, 3, n), torque (m, n)."""
    work = np.empty((motion.shape[2], WORK))
    for k in range(motion.shape[0]):
        inverse_kernel(rows, motion[k, 0], motion[k, 1], motion[k, 2], work, torque[k])


def inverse_dynamics(
    chain: Chain,
    q: ArrayLike,
    qd: ArrayLike,
    qdd: ArrayLike,
    wrench: ArrayLike | None = None,
    gravity: ArrayLike | None = None,
) -> Array:
    """Joint torques of a motion: tau = M q_ddot + C q_dot + B q_dot + G + J^T F.

    M = D + J includes the reflected motor inertia, B is the viscous friction; both are zero for
    a robot that gives none. Recursive Newton-Euler ("On-line computational scheme for mechanical
    manipulators").

    Args:
        chain: The robot.
        q: Positions, (n,) or (..., n) [rad or m].
        qd: Velocities, (n,) or (..., n) [rad/s or m/s].
        qdd: Accelerations, (n,) or (..., n) [rad/s^2 or m/s^2].
        wrench: F = [f; n] that the tip exerts on its surroundings, at the tip, in the base
            frame, (6,) or (..., 6) [N, N m]; a load on the tip is -F.
        gravity: (3,) [m/s^2] in the base frame; the robot's own where none is given.

    Returns:
        Shape (..., n) [N m or N].

    Raises:
        InvalidRobotState: A vector has the wrong length, is not finite or fits no other's batch.
        MissingInertia: No link that a joint carries has an inertia.
    """
    packed = bodies(chain, gravity)
    motion, lead = stack_vectors(chain, joints=q, velocities=qd, accelerations=qdd)
    torque = np.empty((motion.shape[0], chain.n))
    inverse_batch_kernel(packed.rows, motion, torque)
    torque = torque.reshape(*lead, chain.n)
    return torque if wrench is None else torque + holding_torques(chain, q, wrench)
