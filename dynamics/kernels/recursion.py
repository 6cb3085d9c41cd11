"""Newton-Euler recursions in the frames of the joints, for one velocity and for two.

With two, the velocity v of a reference beside the robot's own q_dot, a body's momentum balance is

    f = m A + u' x h + u x (w x h),
    n = h x A + I u' + w x (I u) - tr(I) (w x u) / 2,

with w and u the spins that q_dot and v cause, u' and A the rates of u and of the origin's velocity,
and m, h, I the mass, first moment and inertia about the origin. These are the integrals over all
points p of the body of J_p a + J_p_dot v, so that the torques are D a + C v with the very C of the
Christoffel symbols.
"""

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import Vector, add, column, cross, load, scale
from dynamics.model.body import (
    COULOMB,
    FIRST_MOMENT,
    FRAME,
    FRICTION,
    INERTIA,
    MASS,
    MOTOR,
    ORIGIN_COLUMN,
    REVOLUTE,
    TYPE,
    Z_COLUMN,
    dry_friction,
    symmetric,
    to_child,
    to_parent,
)
from kinematics.arrays import Array

# Columns of scratch for each joint.
COSINE = 0
SINE = 1
#: First of three, as are those below: the joint's origin in the frame of its parent [m].
ORIGIN = 2
#: Force on the body, in the joint's frame [N]; gravity there [m/s^2] for ``gravity_kernel``.
FORCE = 5
#: Moment on the body about the joint's origin [N m].
MOMENT = 8
#: How many.
WORK = 11


@kernel(fastmath=True, allocates=False)
def move_joint(row: Array, q: float, work: Array) -> tuple[float, float, Vector]:
    """Cosine, sine and origin in the parent's frame of a joint at q, stored in ``work`` (11,)."""
    c, s, p = 1.0, 0.0, column(row, FRAME + ORIGIN_COLUMN)
    if row[TYPE] == REVOLUTE:
        c, s = np.cos(q), np.sin(q)
    else:
        z = column(row, FRAME + Z_COLUMN)
        p = (p[0] + q * z[0], p[1] + q * z[1], p[2] + q * z[2])
    work[COSINE], work[SINE] = c, s
    work[ORIGIN], work[ORIGIN + 1], work[ORIGIN + 2] = p
    return c, s, p


@kernel(fastmath=True, allocates=False)
def gather(rows: Array, work: Array, torque: Array) -> None:
    """Sum forces and moments from the tip to the base, and write their parts along the joints."""
    n = torque.shape[0]
    force, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(n - 1, -1, -1):
        row, own = rows[i], work[i]
        force = add(force, load(own, FORCE))
        moment = add(moment, load(own, MOMENT))
        torque[i] = moment[2] if row[TYPE] == REVOLUTE else force[2]
        if i > 0:
            force = to_parent(row, own[COSINE], own[SINE], force)
            moment = to_parent(row, own[COSINE], own[SINE], moment)
            moment = add(moment, cross(load(own, ORIGIN), force))


@kernel(fastmath=True, inline="code", allocates=False)
def inverse_kernel(
    rows: Array, q: Array, qd: Array, qdd: Array, work: Array, torque: Array
) -> None:
    """Write tau = M q_ddot + C q_dot + B q_dot + G into ``torque`` (n,); ``work`` is (n, 11)."""
    n = torque.shape[0]
    w, dw = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    # A base that accelerates upwards is the same as gravity downwards.
    A = (-rows[n, 0], -rows[n, 1], -rows[n, 2])
    for i in range(n):
        row, own = rows[i], work[i]
        c, s, p = move_joint(row, q[i], own)
        if i > 0:
            A = add(A, add(cross(dw, p), cross(w, cross(w, p))))
            w, dw = to_child(row, c, s, w), to_child(row, c, s, dw)
        A = to_child(row, c, s, A)
        if row[TYPE] == REVOLUTE:
            dw = (dw[0] + w[1] * qd[i], dw[1] - w[0] * qd[i], dw[2] + qdd[i])
            w = (w[0], w[1], w[2] + qd[i])
        else:
            A = (A[0] + 2.0 * w[1] * qd[i], A[1] - 2.0 * w[0] * qd[i], A[2] + qdd[i])
        h, U, T = load(row, FIRST_MOMENT), load(row, INERTIA), load(row, INERTIA + 3)
        f = add(scale(row[MASS], A), add(cross(dw, h), cross(w, cross(w, h))))
        m = add(cross(h, A), add(symmetric(U, T, dw), cross(w, symmetric(U, T, w))))
        own[FORCE], own[FORCE + 1], own[FORCE + 2] = f
        own[MOMENT], own[MOMENT + 1], own[MOMENT + 2] = m
    gather(rows, work, torque)
    for i in range(n):
        torque[i] += rows[i, MOTOR] * qdd[i] + rows[i, FRICTION] * qd[i]
    if rows[n, COULOMB] != 0.0:
        for i in range(n):
            torque[i] += dry_friction(rows[i, COULOMB], qd[i])


@kernel(fastmath=True, allocates=False)
def gravity_kernel(rows: Array, q: Array, work: Array, G: Array) -> None:
    """Write G(q) into G (n,): what hangs on each joint pulls; ``work`` is (n, 11)."""
    n = G.shape[0]
    g = (rows[n, 0], rows[n, 1], rows[n, 2])
    for i in range(n):
        c, s, _ = move_joint(rows[i], q[i], work[i])
        g = to_child(rows[i], c, s, g)
        work[i][FORCE], work[i][FORCE + 1], work[i][FORCE + 2] = g
    # Mass and first moment about o_i of all that joint i carries.
    mass, h = 0.0, (0.0, 0.0, 0.0)
    for i in range(n - 1, -1, -1):
        row, own = rows[i], work[i]
        h = add(h, load(row, FIRST_MOMENT))
        mass += row[MASS]
        g = load(own, FORCE)
        G[i] = g[0] * h[1] - g[1] * h[0] if row[TYPE] == REVOLUTE else -mass * g[2]
        if i > 0:
            h = to_parent(row, own[COSINE], own[SINE], h)
            h = add(h, scale(mass, load(own, ORIGIN)))


@kernel(fastmath=True, allocates=False)
def advance(
    row: Array, motion: Array, w: Vector, u: Vector, du: Vector, A: Vector, own: Array
) -> tuple[Vector, Vector, Vector, Vector]:
    """Carry w, u, u' and A from the parent's frame to that of a joint and add its own motion.

    ``motion`` (4,) holds q, q_dot, v and a of the joint.
    """
    c, s, p = move_joint(row, motion[0], own)
    qd, v, a = motion[1], motion[2], motion[3]
    A = to_child(row, c, s, add(A, add(cross(du, p), cross(u, cross(w, p)))))
    w, u, du = to_child(row, c, s, w), to_child(row, c, s, u), to_child(row, c, s, du)
    if row[TYPE] == REVOLUTE:
        du = (du[0] + w[1] * v, du[1] - w[0] * v, du[2] + a)
        w, u = (w[0], w[1], w[2] + qd), (u[0], u[1], u[2] + v)
    else:
        A = (A[0] + w[1] * v + u[1] * qd, A[1] - w[0] * v - u[0] * qd, A[2] + a)
    return w, u, du, A


@kernel(fastmath=True, allocates=False)
def reference_inverse_kernel(rows: Array, motion: Array, work: Array, torque: Array) -> None:
    """Write M a + C(q, q_dot) v + B q_dot + G into ``torque`` (n,).

    ``motion`` (n, 4) holds q, q_dot, v and a of each joint; ``work`` is (n, 11).
    """
    n = torque.shape[0]
    w, u, du = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    A = (-rows[n, 0], -rows[n, 1], -rows[n, 2])
    for i in range(n):
        row, own = rows[i], work[i]
        w, u, du, A = advance(row, motion[i], w, u, du, A, own)
        h, U, T = load(row, FIRST_MOMENT), load(row, INERTIA), load(row, INERTIA + 3)
        f = add(scale(row[MASS], A), add(cross(du, h), cross(u, cross(w, h))))
        half = -0.5 * (row[INERTIA] + row[INERTIA + 2] + row[INERTIA + 5])
        m = add(cross(h, A), add(symmetric(U, T, du), cross(w, symmetric(U, T, u))))
        m = add(m, scale(half, cross(w, u)))
        own[FORCE], own[FORCE + 1], own[FORCE + 2] = f
        own[MOMENT], own[MOMENT + 1], own[MOMENT + 2] = m
    gather(rows, work, torque)
    for i in range(n):
        torque[i] += rows[i, MOTOR] * motion[i, 3] + rows[i, FRICTION] * motion[i, 1]
    if rows[n, COULOMB] != 0.0:
        for i in range(n):
            torque[i] += dry_friction(rows[i, COULOMB], motion[i, 1])
