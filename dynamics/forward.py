"""Forward dynamics: joint torques to motion."""

import numpy as np
from numpy.typing import ArrayLike

from compiled.kernel import kernel
from compiled.linear_solve import cholesky_solve_kernel
from dynamics.kernels.composite import COMPOSITE_WORK, frames_kernel, mass_matrix_kernel
from dynamics.kernels.recursion import inverse_kernel
from dynamics.model.body import MOTOR, bodies, joints_without_inertia
from kinematics.arrays import Array
from kinematics.errors import MissingInertia
from kinematics.model.chain import Chain, stack_vectors
from kinematics.velocity import holding_torques


@kernel
def acceleration_kernel(
    rows: Array, q: Array, qd: Array, torque: Array, work: Array, M: Array, qdd: Array
) -> int:
    """Write q_ddot (n,) for the joint torques; ``work`` (n, 30) and ``M`` (n, n) are scratch.

    Returns:
        -1, or the first joint at which M(q) is not positive definite.
    """
    n = q.shape[0]
    for i in range(n):
        qdd[i] = 0.0
    bias = M[0]
    inverse_kernel(rows, q, qd, qdd, work, bias)
    for i in range(n):
        qdd[i] = torque[i] - bias[i]
    frames_kernel(rows, q, work)
    mass_matrix_kernel(rows, work, M)
    for i in range(n):
        M[i, i] += rows[i, MOTOR]
    return cholesky_solve_kernel(M, qdd, n)


@kernel
def forward_dynamics_kernel(rows: Array, state: Array, qdd: Array) -> int:
    """Write q_ddot of a batch into ``qdd`` (m, n); state (m, 3, n) holds q, q_dot and tau.

    Returns:
        -1, or the first joint at which some M(q) is not positive definite.
    """
    n = qdd.shape[1]
    work, M = np.empty((n, COMPOSITE_WORK)), np.empty((n, n))
    for k in range(qdd.shape[0]):
        q, qd, torque = state[k, 0], state[k, 1], state[k, 2]
        failed = acceleration_kernel(rows, q, qd, torque, work, M, qdd[k])
        if failed >= 0:
            return failed
    return -1


def forward_dynamics(
    chain: Chain,
    q: ArrayLike,
    qd: ArrayLike,
    torque: ArrayLike,
    wrench: ArrayLike | None = None,
    gravity: ArrayLike | None = None,
) -> Array:
    """Accelerations q_ddot = M^-1 (tau - C q_dot - B q_dot - G - J^T F).

    Args:
        chain: The robot.
        q: Positions, (n,) or (..., n) [rad or m].
        qd: Velocities, (n,) or (..., n) [rad/s or m/s].
        torque: Joint torques tau, (n,) or (..., n) [N m or N].
        wrench: F = [f; n] that the tip exerts on its surroundings, at the tip, in the base
            frame, (6,) or (..., 6) [N, N m].
        gravity: (3,) [m/s^2] in the base frame; the robot's own where none is given.

    Returns:
        Shape (..., n) [rad/s^2 or m/s^2].

    Raises:
        InvalidRobotState: A vector has the wrong length, is not finite or fits no other's batch.
        MissingInertia: No link has an inertia, or what some joint carries has
            neither mass nor inertia about its axis.
    """
    packed = bodies(chain, gravity)
    if wrench is not None:
        torque = chain.configuration(torque, "torques") - holding_torques(chain, q, wrench)
    state, lead = stack_vectors(chain, joints=q, velocities=qd, torques=torque)
    qdd = np.empty((state.shape[0], chain.n))
    failed = forward_dynamics_kernel(packed.rows, state, qdd)
    if failed >= 0:
        raise massless(chain, failed)
    return qdd.reshape(*lead, chain.n)


def massless(chain: Chain, joint: int) -> MissingInertia:
    """The error that M(q) is not positive definite at ``joint``.

    Args:
        chain: The robot.
        joint: Index of the first joint at which the decomposition of M(q) failed.
    """
    names = joints_without_inertia(chain)
    name = names[0] if names else chain.joint_names[joint]
    return MissingInertia(
        f"the mass matrix is not positive definite at joint {name!r}: "
        "what it carries has no inertia about its axis",
        hint=f"Give the links beyond {name!r} a mass and an inertia tensor, "
        "or the joint a motor inertia.",
        joint=name,
    )
