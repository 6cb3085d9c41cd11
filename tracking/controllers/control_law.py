"""The controllers of this package in compiled form: torque, adaptation and Lyapunov function."""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from dynamics.kernels.composite import COMPOSITE_WORK, frames_kernel, mass_matrix_kernel
from dynamics.kernels.recursion import gravity_kernel, inverse_kernel, reference_inverse_kernel
from dynamics.model.body import MOTOR, ROW, bodies
from dynamics.parameters.regressor import motor_columns, regressor_kernel
from kinematics.arrays import Array
from kinematics.model.chain import Chain


class Kind(IntEnum):
    """Controller of a ``Law``."""

    INDEPENDENT_JOINT = 0
    COMPUTED_TORQUE = 1
    PD_GRAVITY = 2
    PASSIVITY = 3
    ADAPTIVE = 4


class Law(NamedTuple):
    """A controller as arrays (n joints, b estimated parameters); what it does not use is 0.

    Args:
        kind: One of ``Kind``.
        rows: The model that it believes in, ``dynamics.model.body.Bodies.rows``.
        Kp: Stiffness, shape (n, n).
        Kd: Damping, or K of the filtered error, shape (n, n).
        Lambda: Gain of the filtered error, shape (n,).
        inertia: Fed forward with the acceleration, shape (n,).
        friction: Fed forward with the velocity, shape (n,).
        columns: Columns of the regressor that are estimated, shape (b,).
        Gamma: Adaptation gain, shape (b, b).
        Gamma_inverse: Shape (b, b).
        truth: The parameters that are estimated, of the true robot, shape (b,).
        known_columns: Columns of the regressor whose parameters are taken as known, shape (k,).
        known: Values of the known parameters, shape (k,).
        robot: The true robot's rows.
    """

    kind: int
    rows: Array
    Kp: Array
    Kd: Array
    Lambda: Array
    inertia: Array
    friction: Array
    columns: NDArray[np.int64]
    Gamma: Array
    Gamma_inverse: Array
    truth: Array
    known_columns: NDArray[np.int64]
    known: Array
    robot: Array


class Estimated(NamedTuple):
    """Parameters that an adaptive law learns (b of them), and those that it takes as known (k).

    Args:
        columns: Columns of the regressor that are estimated, shape (b,).
        Gamma: Adaptation gain, shape (b, b).
        truth: The parameters that are estimated, of the true robot, shape (b,).
        known_columns: Columns of the regressor whose parameters are known, shape (k,).
        known: Values of the known parameters, shape (k,).
    """

    columns: NDArray[np.int64]
    Gamma: Array
    truth: Array
    known_columns: NDArray[np.int64]
    known: Array


def _no_estimate() -> Estimated:
    none, empty = np.zeros(0, np.int64), np.zeros(0)
    return Estimated(none, np.zeros((0, 0)), empty, none, empty)


def law(
    kind: Kind,
    model: Chain,
    robot: Chain | None,
    *,
    Kp: Array | None = None,
    Kd: Array | None = None,
    Lambda: Array | None = None,
    motors: tuple[Array, Array] | None = None,
    estimated: Estimated | None = None,
) -> Law:
    """A law of a model, to drive a robot.

    Args:
        kind: Kind of the controller.
        model: Model that the controller has. Independent joint control reads the motors alone, so
            a model without inertias will do.
        robot: The true robot; the model where none is given.
        Kp: Shape (n, n).
        Kd: Shape (n, n).
        Lambda: Shape (n,).
        motors: Inertia and viscous friction at the joints, shape (n,) each.
        estimated: Parameters that are learned; none where nothing is.

    Raises:
        MissingInertia: The robot, or the model where it matters, lacks an inertia.
    """
    n = model.n
    if kind is Kind.INDEPENDENT_JOINT:
        believed = np.zeros((n + 1, ROW)) if robot is None else bodies(robot).rows
    else:
        believed = bodies(model).rows
    rows = believed if robot is None else bodies(robot).rows
    learned = estimated or _no_estimate()
    inertia, friction = motors or (None, None)
    Gamma = learned.Gamma
    inverse = np.linalg.inv(Gamma) if len(learned.columns) else Gamma
    # Copies: the compiled loop is made for writable arrays, and read-only ones are another type.
    return Law(
        int(kind),
        np.array(believed),
        _or_zero(Kp, (n, n)),
        _or_zero(Kd, (n, n)),
        _or_zero(Lambda, (n,)),
        _or_zero(inertia, (n,)),
        _or_zero(friction, (n,)),
        np.array(learned.columns, dtype=np.int64),
        np.array(Gamma),
        np.array(inverse),
        np.array(learned.truth),
        np.array(learned.known_columns, dtype=np.int64),
        np.array(learned.known),
        np.array(rows),
    )


def _or_zero(value: Array | None, shape: tuple[int, ...]) -> Array:
    return np.zeros(shape) if value is None else np.array(value, order="C")


class Space(NamedTuple):
    """Scratch of the laws' kernels.

    Args:
        work: Shape (n, 30).
        frames: Shape (n, 12).
        motion: Shape (n, 4).
        Y: Shape (n, 12 n), or (n, 0) for laws without a regressor.
        M: Shape (n, n).
        vectors: Shape (6, n).
    """

    work: Array
    frames: Array
    motion: Array
    Y: Array
    M: Array
    vectors: Array


def space(n: int, law: Law) -> Space:
    """Scratch for a law of n joints."""
    # Columns of dry friction come last, for robots that have any.
    last = max(law.columns.max(initial=0), law.known_columns.max(initial=0))
    kinds = 13 if last >= 12 * n else 12
    p = kinds * n if law.kind == Kind.ADAPTIVE else 0
    return Space(
        np.zeros((n, COMPOSITE_WORK)),
        np.zeros((n, 12)),
        np.zeros((n, 4)),
        np.zeros((n, p)),
        np.zeros((n, n)),
        np.zeros((6, n)),
    )


@kernel(allocates=False)
def add_product(A: Array, x: Array, y: Array) -> None:
    """Add A x to y (n,), with A of shape (n, n)."""
    for i in range(y.shape[0]):
        s = 0.0
        for j in range(y.shape[0]):
            s += A[i, j] * x[j]
        y[i] += s


@kernel
def quadratic(A: Array, x: Array, y: Array) -> float:
    """The form x^T A y."""
    s = 0.0
    for i in range(x.shape[0]):
        for j in range(y.shape[0]):
            s += x[i] * A[i, j] * y[j]
    return s


@kernel(allocates=False)
def set_errors(law: Law, space: Space, q: Array, qd: Array, reference: Array) -> None:
    """Write e, e_dot and r into ``space.vectors`` and (q, q_dot, v, a) into ``space.motion``."""
    for i in range(q.shape[0]):
        e, rate = reference[0, i] - q[i], reference[1, i] - qd[i]
        space.vectors[0, i], space.vectors[1, i] = e, rate
        space.vectors[2, i] = rate + law.Lambda[i] * e
        space.motion[i, 0], space.motion[i, 1] = q[i], qd[i]
        space.motion[i, 2] = reference[1, i] + law.Lambda[i] * e
        space.motion[i, 3] = reference[2, i] + law.Lambda[i] * rate


@kernel(allocates=False)
def control_kernel(
    law: Law, space: Space, state: Array, reference: Array, estimate: Array, u: Array, rate: Array
) -> None:
    """Write the torque asked into u (n,) and the estimate's rate of change into rate (b,).

    ``state`` (2, n) holds q and q_dot, ``reference`` (3, n) the reference and its derivatives.
    """
    n = u.shape[0]
    q, qd = state[0], state[1]
    set_errors(law, space, q, qd, reference)
    e, e_rate, r = space.vectors[0], space.vectors[1], space.vectors[2]
    if law.kind == Kind.INDEPENDENT_JOINT:
        for i in range(n):
            u[i] = law.inertia[i] * reference[2, i] + law.friction[i] * reference[1, i]
        add_product(law.Kp, e, u)
        add_product(law.Kd, e_rate, u)
    elif law.kind == Kind.COMPUTED_TORQUE:
        v = space.vectors[3]
        for i in range(n):
            v[i] = reference[2, i]
        add_product(law.Kp, e, v)
        add_product(law.Kd, e_rate, v)
        inverse_kernel(law.rows, q, qd, v, space.work, u)
    elif law.kind == Kind.PD_GRAVITY:
        gravity_kernel(law.rows, q, space.work, u)
        add_product(law.Kp, e, u)
        add_product(law.Kd, e_rate, u)
    elif law.kind == Kind.PASSIVITY:
        reference_inverse_kernel(law.rows, space.motion, space.work, u)
        add_product(law.Kd, r, u)
    else:
        adaptive_kernel(law, space, q, estimate, u, rate)


@kernel(allocates=False)
def adaptive_kernel(
    law: Law, space: Space, q: Array, estimate: Array, u: Array, rate: Array
) -> None:
    """U = Y(q, q_dot, a, v) Theta_hat + K r and the rate Gamma Y^T r of the estimate."""
    n, b = u.shape[0], rate.shape[0]
    r = space.vectors[2]
    frames_kernel(law.rows, q, space.frames)
    regressor_kernel(law.rows, space.motion, space.work, space.frames, space.Y)
    motor_columns(space.motion, space.Y)
    for i in range(n):
        s = 0.0
        for k in range(b):
            s += space.Y[i, law.columns[k]] * estimate[k]
        for k in range(law.known.shape[0]):
            s += space.Y[i, law.known_columns[k]] * law.known[k]
        u[i] = s
    add_product(law.Kd, r, u)
    for k in range(b):
        rate[k] = 0.0
    for k in range(b):
        s = 0.0
        for i in range(n):
            s += space.Y[i, law.columns[k]] * r[i]
        for j in range(b):
            rate[j] += law.Gamma[j, k] * s


@kernel(allocates=False)
def lyapunov_kernel(
    law: Law, space: Space, state: Array, reference: Array, estimate: Array
) -> float:
    """The Lyapunov function of the law, with the true robot's mass matrix and parameters."""
    n = state.shape[1]
    set_errors(law, space, state[0], state[1], reference)
    e, e_rate, r = space.vectors[0], space.vectors[1], space.vectors[2]
    V = 0.0
    if law.kind == Kind.INDEPENDENT_JOINT:
        for i in range(n):
            V += 0.5 * law.inertia[i] * e_rate[i] ** 2
        return V + 0.5 * quadratic(law.Kp, e, e)
    if law.kind == Kind.COMPUTED_TORQUE:
        for i in range(n):
            kp, kd = law.Kp[i, i], law.Kd[i, i]
            V += 0.5 * (e_rate[i] ** 2 + (kp + 0.5 * kd**2) * e[i] ** 2 + kd * e[i] * e_rate[i])
        return V
    M = space.M
    frames_kernel(law.robot, state[0], space.work)
    mass_matrix_kernel(law.robot, space.work, M)
    for i in range(n):
        M[i, i] += law.robot[i, MOTOR]
    if law.kind == Kind.PD_GRAVITY:
        return 0.5 * (quadratic(M, state[1], state[1]) + quadratic(law.Kp, e, e))
    V = 0.5 * quadratic(M, r, r)
    for i in range(n):
        space.vectors[3, i] = law.Lambda[i] * e[i]
    V += quadratic(law.Kd, space.vectors[3], e)
    if law.kind == Kind.ADAPTIVE:
        for j in range(estimate.shape[0]):
            for k in range(estimate.shape[0]):
                off = (estimate[j] - law.truth[j]) * (estimate[k] - law.truth[k])
                V += 0.5 * law.Gamma_inverse[j, k] * off
    return V


@kernel(allocates=False)
def lyapunov_rate_kernel(
    law: Law, space: Space, state: Array, reference: Array, estimate: Array, rate: Array
) -> float:
    """V_dot of the law, with the true robot's mass matrix and parameters.

    Args:
        law: The law.
        space: Scratch.
        state: q and q_dot, shape (2, n).
        reference: The reference and its two derivatives, shape (3, n).
        estimate: Theta_hat, shape (b,).
        rate: Time derivative of [q; q_dot; estimate], shape (2 n + b,).
    """
    n = state.shape[1]
    set_errors(law, space, state[0], state[1], reference)
    e, e_rate, r = space.vectors[0], space.vectors[1], space.vectors[2]
    bend, qdd = space.vectors[3], rate[n : 2 * n]
    for i in range(n):
        bend[i] = reference[2, i] - qdd[i]
    V_dot = 0.0
    if law.kind == Kind.INDEPENDENT_JOINT:
        for i in range(n):
            V_dot += law.inertia[i] * e_rate[i] * bend[i]
        return V_dot + quadratic(law.Kp, e, e_rate)
    if law.kind == Kind.COMPUTED_TORQUE:
        for i in range(n):
            kp, kd = law.Kp[i, i], law.Kd[i, i]
            V_dot += e_rate[i] * bend[i] + (kp + 0.5 * kd**2) * e[i] * e_rate[i]
            V_dot += 0.5 * kd * (e_rate[i] ** 2 + e[i] * bend[i])
        return V_dot
    if law.kind == Kind.PD_GRAVITY:
        V_dot = kinetic_rate(law, space, state, state[1], qdd)
        return V_dot + quadratic(law.Kp, e, e_rate)
    for i in range(n):
        bend[i] += law.Lambda[i] * e_rate[i]
    V_dot = kinetic_rate(law, space, state, r, bend)
    for i in range(n):
        bend[i] = law.Lambda[i] * e[i]
    V_dot += quadratic(law.Kd, bend, e_rate)
    for i in range(n):
        bend[i] = law.Lambda[i] * e_rate[i]
    V_dot += quadratic(law.Kd, e, bend)
    if law.kind == Kind.ADAPTIVE:
        for j in range(estimate.shape[0]):
            for k in range(estimate.shape[0]):
                V_dot += law.Gamma_inverse[j, k] * (estimate[j] - law.truth[j]) * rate[2 * n + k]
    return V_dot


@kernel(allocates=False)
def kinetic_rate(law: Law, space: Space, state: Array, r: Array, r_rate: Array) -> float:
    """The rate r^T (M r_dot + C r) of r^T M r / 2, for the true robot; r and r_rate are (n,)."""
    n = state.shape[1]
    whole, rest = space.vectors[4], space.vectors[5]
    for i in range(n):
        space.motion[i, 0], space.motion[i, 1] = state[0, i], state[1, i]
        space.motion[i, 2], space.motion[i, 3] = 0.0, 0.0
    reference_inverse_kernel(law.robot, space.motion, space.work, rest)
    for i in range(n):
        space.motion[i, 2], space.motion[i, 3] = r[i], r_rate[i]
    reference_inverse_kernel(law.robot, space.motion, space.work, whole)
    total = 0.0
    for i in range(n):
        # Gravity and friction, which do not depend on r, drop out.
        total += r[i] * (whole[i] - rest[i])
    return total
