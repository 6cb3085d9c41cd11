"""Inverse dynamics: motion to joint torques, by the recursive Newton-Euler algorithm."""

import numpy as np
from numpy.typing import ArrayLike

from dynamics.batch import stacked
from dynamics.body import Bodies, bodies
from dynamics.vector import (
    Vector,
    add,
    apply,
    apply_transposed,
    axis,
    cross,
    dot,
    origin,
    row,
    scale,
    subtract,
)
from kinematics.chain import Array, Chain
from kinematics.errors import InvalidOption
from kinematics.forward import forward_kernel
from kinematics.jacobian import geometric
from kinematics.kernel import kernel


@kernel
def acceleration_at(rate: Vector, spin: Vector, arm: Vector) -> Vector:
    """Acceleration w_dot x r + w x (w x r) of a point relative to one ``arm`` = r before it."""
    return add(cross(rate, arm), cross(spin, cross(spin, arm)))


@kernel
def inverse_kernel(
    bodies: Bodies, motion: Array, frames: Array, loads: Array, torque: Array
) -> None:
    """Write tau = M q_ddot + C q_dot + B q_dot + G into ``torque`` (n,).

    All vectors are in the axes of the base. ``motion`` (3, n) holds q, q_dot and q_ddot;
    ``frames`` (n, 4, 4) and ``loads`` (2, n, 3) are scratch, the frames are right afterwards.
    """
    q, qd, qdd = motion[0], motion[1], motion[2]
    n = q.shape[0]
    forward_kernel(bodies.types, bodies.offsets, q, frames)
    spin, rate, last = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    # A base that accelerates upwards is the same as gravity downwards.
    a = (-bodies.gravity[0], -bodies.gravity[1], -bodies.gravity[2])
    for i in range(n):
        z, o = axis(frames, i), origin(frames, i)
        a = add(a, acceleration_at(rate, spin, subtract(o, last)))
        if bodies.types[i] == 0:
            rate = add(rate, add(scale(qdd[i], z), scale(qd[i], cross(spin, z))))
            spin = add(spin, scale(qd[i], z))
        else:
            a = add(a, add(scale(qdd[i], z), scale(2.0 * qd[i], cross(spin, z))))
        center = apply(frames[i], row(bodies.centers, i))
        force = scale(bodies.masses[i], add(a, acceleration_at(rate, spin, center)))
        # Euler's equation N = I w_dot + w x (I w), in the body's own axes, where I is constant.
        tensor, w = bodies.tensors[i], apply_transposed(frames[i], spin)
        N = add(apply(tensor, apply_transposed(frames[i], rate)), cross(w, apply(tensor, w)))
        moment = add(apply(frames[i], N), cross(center, force))
        for k in range(3):
            loads[0, i, k], loads[1, i, k] = force[k], moment[k]
        last = o
    force, moment, beyond = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), last
    for i in range(n - 1, -1, -1):
        z, o = axis(frames, i), origin(frames, i)
        moment = add(add(moment, cross(subtract(beyond, o), force)), row(loads[1], i))
        force = add(force, row(loads[0], i))
        torque[i] = dot(z, moment) if bodies.types[i] == 0 else dot(z, force)
        torque[i] += bodies.motor_inertia[i] * qdd[i] + bodies.viscous_friction[i] * qd[i]
        beyond = o


@kernel
def inverse_batch_kernel(bodies: Bodies, motion: Array, torque: Array) -> None:
    """``inverse_kernel`` for a batch: motion (m, 3, n), torque (m, n)."""
    n = motion.shape[2]
    frames, loads = np.empty((n, 4, 4)), np.empty((2, n, 3))
    for k in range(motion.shape[0]):
        inverse_kernel(bodies, motion[k], frames, loads, torque[k])


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
        MissingInertia: Some joint carries nothing that has an inertia.
    """
    packed = bodies(chain, gravity)
    motion, lead = stacked(chain, joints=q, velocities=qd, accelerations=qdd)
    torque = np.empty((motion.shape[0], chain.n))
    inverse_batch_kernel(packed, motion, torque)
    torque = torque.reshape(*lead, chain.n)
    return torque if wrench is None else torque + wrench_torque(chain, q, wrench)


def wrench_torque(chain: Chain, q: ArrayLike, wrench: ArrayLike) -> Array:
    """Joint torques J(q)^T F that hold the wrench F = [f; n] (..., 6) at the tip, (..., n).

    Raises:
        InvalidOption: The wrench is not six finite numbers (or a batch that fits the joints').
    """
    F = np.array(wrench, dtype=np.float64)
    if F.ndim == 0 or F.shape[-1] != 6 or not np.isfinite(F).all():
        raise InvalidOption("wrench must be six finite numbers [fx, fy, fz, nx, ny, nz]")
    J = geometric(chain, q)
    try:
        return np.asarray(np.einsum("...ij,...i->...j", J, F))
    except ValueError:
        raise InvalidOption(
            f"a batch of wrenches {F.shape} does not fit joints {np.shape(q)}"
        ) from None
