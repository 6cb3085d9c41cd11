"""The equations of motion, linear in the parameters of the bodies: tau = Y Theta."""

import numpy as np
from numpy.typing import ArrayLike

from compiled.kernel import kernel
from compiled.vec3 import Vector, column, cross, dot, load, scale, subtract
from dynamics.kernels.composite import FRAME, frames_kernel
from dynamics.kernels.recursion import WORK, advance
from dynamics.model.body import (
    COULOMB,
    FRICTION,
    MASS,
    MOTOR,
    ORIGIN_COLUMN,
    REVOLUTE,
    SMOOTH_SPEED,
    TYPE,
    Z_COLUMN,
    bodies,
)
from kinematics.arrays import Array, frozen
from kinematics.model.chain import Chain, stack_vectors

#: The standard parameters of one body, in their order; inertia about the joint frame's origin.
BODY_PARAMETERS = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")


@kernel(fastmath=True, allocates=False)
def inertia_columns(w: Vector, u: Vector, du: Vector, z: Vector, out: Array) -> None:
    """Write the parts along z of the moments of unit inertias into ``out[4:10]``.

    That is of I u' + w x (I u) - tr(I) (w x u) / 2, for each of the six entries of I.
    """
    g = cross(w, u)
    along = 0.5 * dot(z, g)
    x, y, zz = z
    out[4] = x * du[0] + y * w[2] * u[0] - zz * w[1] * u[0] - along
    out[5] = (
        x * (du[1] - w[2] * u[0]) + y * (du[0] + w[2] * u[1]) + zz * (w[0] * u[0] - w[1] * u[1])
    )
    out[6] = y * du[1] - x * w[2] * u[1] + zz * w[0] * u[1] - along
    out[7] = (
        x * (du[2] + w[1] * u[0]) + y * (w[2] * u[2] - w[0] * u[0]) + zz * (du[0] - w[1] * u[2])
    )
    out[8] = (
        x * (w[1] * u[1] - w[2] * u[2]) + y * (du[2] - w[0] * u[1]) + zz * (du[1] + w[0] * u[2])
    )
    out[9] = zz * du[2] + x * w[1] * u[2] - y * w[0] * u[2] - along


@kernel(fastmath=True, allocates=False)
def regressor_kernel(rows: Array, motion: Array, work: Array, frames: Array, Y: Array) -> None:
    """Write Y(q, q_dot, v, a) of the bodies' standard parameters into Y (n, 10 n).

    ``motion`` (n, 4) holds q, q_dot, v and a; ``work`` (n, 11) is scratch, ``frames`` (n, .) are
    the joint frames at q.
    """
    n = motion.shape[0]
    w, u, du = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    A = scale(-1.0, load(rows[n], 0))
    for j in range(n):
        w, u, du, A = advance(rows[j], motion[j], w, u, du, A, work[j])
        # Columns of u' x + u x (w x .), what a first moment h is multiplied with.
        wu = dot(w, u)
        X = (w[0] * u[0] - wu, w[1] * u[0] + du[2], w[2] * u[0] - du[1])
        P = (w[0] * u[1] - du[2], w[1] * u[1] - wu, w[2] * u[1] + du[0])
        Q = (w[0] * u[2] + du[1], w[1] * u[2] - du[0], w[2] * u[2] - wu)
        F = frames[j]
        for i in range(j + 1):
            E, out = frames[i], Y[i, 10 * j : 10 * j + 10]
            z = to_frame(F, column(E, Z_COLUMN))
            if rows[i, TYPE] == REVOLUTE:
                arm = to_frame(F, subtract(column(F, ORIGIN_COLUMN), column(E, ORIGIN_COLUMN)))
                v = cross(z, arm)
                out[0] = dot(v, A)
                out[1] = dot(v, X) + z[2] * A[1] - z[1] * A[2]
                out[2] = dot(v, P) + z[0] * A[2] - z[2] * A[0]
                out[3] = dot(v, Q) + z[1] * A[0] - z[0] * A[1]
                inertia_columns(w, u, du, z, out)
            else:
                out[0], out[1], out[2], out[3] = dot(z, A), dot(z, X), dot(z, P), dot(z, Q)
                for k in range(4, 10):
                    out[k] = 0.0
        for i in range(j + 1, n):
            for k in range(10 * j, 10 * j + 10):
                Y[i, k] = 0.0


@kernel(fastmath=True, allocates=False)
def to_frame(F: Array, a: Vector) -> Vector:
    """A vector of the base in the axes of the frame ``F``."""
    return (
        F[0] * a[0] + F[4] * a[1] + F[8] * a[2],
        F[1] * a[0] + F[5] * a[1] + F[9] * a[2],
        F[2] * a[0] + F[6] * a[1] + F[10] * a[2],
    )


@kernel
def regressor_batch_kernel(rows: Array, state: Array, Y: Array) -> None:
    """Y of a batch into Y (m, n, p), p = 10 n or 12 n; state (m, 4, n) holds q, q_dot, v and a."""
    n = state.shape[2]
    work, frames, motion = np.empty((n, WORK)), np.empty((n, FRAME)), np.empty((n, 4))
    for k in range(state.shape[0]):
        motion[:] = state[k].T
        frames_kernel(rows, state[k, 0], frames)
        regressor_kernel(rows, motion, work, frames, Y[k])
        motor_columns(motion, Y[k])


@kernel(allocates=False)
def motor_columns(motion: Array, Y: Array) -> None:
    """Write what columns of Y (n, p) come after the bodies' 10 n.

    These are diag(a), diag(q_dot) and, if there is room, diag(tanh(q_dot / v)) of dry friction.
    """
    n = motion.shape[0]
    for kind in range(Y.shape[1] // n - 10):
        first = (10 + kind) * n
        Y[:, first : first + n] = 0.0
        for i in range(n):
            value = motion[i, 3] if kind == 0 else motion[i, 1]
            Y[i, first + i] = value if kind < 2 else np.tanh(value / SMOOTH_SPEED)


def regressor(
    chain: Chain,
    q: ArrayLike,
    qd: ArrayLike,
    qdd: ArrayLike,
    gravity: ArrayLike | None = None,
    *,
    motors: bool = True,
) -> Array:
    """Regressor Y(q, q_dot, q_ddot), with tau = M q_ddot + C q_dot + B q_dot + G = Y Theta.

    Theta is ``standard_parameters(chain, motors=motors)``; Y does not depend on it.

    Args:
        chain: The robot; of its bodies' inertias nothing is read.
        q: Positions, (n,) or (..., n) [rad or m].
        qd: Velocities, (n,) or (..., n) [rad/s or m/s].
        qdd: Accelerations, (n,) or (..., n) [rad/s^2 or m/s^2].
        gravity: (3,) [m/s^2] in the base frame; the robot's own where none is given.
        motors: Add columns of motor inertia and viscous friction.

    Returns:
        Shape (..., n, 12 n), or (..., n, 10 n) without motors.

    Raises:
        InvalidRobotState: A vector has the wrong length, is not finite or fits no other's batch.
        MissingInertia: No link that a joint carries has an inertia.
    """
    return reference_regressor(chain, q, qd, qd, qdd, gravity, motors=motors)


def reference_regressor(
    chain: Chain,
    q: ArrayLike,
    qd: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    gravity: ArrayLike | None = None,
    *,
    motors: bool = True,
) -> Array:
    """Regressor Y(q, q_dot, a, v), with M a + C(q, q_dot) v + B q_dot + G = Y Theta.

    C is that of the Christoffel symbols, so an adaptive controller's proof holds ("On the adaptive
    control of robot manipulators").

    Args:
        chain: The robot; of its bodies' inertias nothing is read.
        q: Positions, (n,) or (..., n) [rad or m].
        qd: Velocities, (n,) or (..., n) [rad/s or m/s].
        v: Reference velocities, (n,) or (..., n) [rad/s or m/s].
        a: Reference accelerations, (n,) or (..., n) [rad/s^2 or m/s^2].
        gravity: (3,) [m/s^2] in the base frame; the robot's own where none is given.
        motors: Add columns of motor inertia and viscous friction.

    Returns:
        Shape (..., n, 12 n), or (..., n, 10 n) without motors.

    Raises:
        InvalidRobotState: A vector has the wrong length, is not finite or fits no other's batch.
        MissingInertia: No link that a joint carries has an inertia.
    """
    packed = bodies(chain, gravity)
    state, lead = stack_vectors(
        chain, joints=q, velocities=qd, reference_velocities=v, accelerations=a
    )
    Y = np.empty((state.shape[0], chain.n, _parameter_count(chain, motors)))
    regressor_batch_kernel(packed.rows, state, Y)
    return Y.reshape(*lead, *Y.shape[1:])


def standard_parameters(chain: Chain, *, motors: bool = True) -> Array:
    """Theta: ten parameters a body, then motor inertias J and viscous frictions B, (12 n,).

    A robot with dry friction has its F as well, shape (13 n,).

    Units: kg, kg m, kg m^2; of the motors kg m^2 or kg, N m s/rad or N s/m.

    Raises:
        MissingInertia: No link that a joint carries has an inertia.
    """
    rows = bodies(chain).rows[:-1]
    parts = [rows[:, MASS:MOTOR].ravel()]
    if motors:
        parts += [rows[:, MOTOR], rows[:, FRICTION]]
        if chain.coulomb_friction.any():
            parts.append(rows[:, COULOMB])
    return frozen(np.concatenate(parts))


def _parameter_count(chain: Chain, motors: bool) -> int:
    kinds = len(BODY_PARAMETERS)
    if motors:
        kinds += 3 if chain.coulomb_friction.any() else 2
    return kinds * chain.n


def parameter_names(chain: Chain, *, motors: bool = True) -> tuple[str, ...]:
    """Names of Theta's entries: a body's parameter and the number of its joint, from 1 on."""
    numbers = range(1, chain.n + 1)
    names = [f"{name}{i}" for i in numbers for name in BODY_PARAMETERS]
    if motors:
        kinds = ("J", "B", "F") if chain.coulomb_friction.any() else ("J", "B")
        names += [f"{name}{i}" for name in kinds for i in numbers]
    return tuple(names)
