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

from kinematics.arrays import Array
from kinematics.compiled.kernel import kernel
from kinematics.vec3 import Vector, add, cross, scale

#: Columns of scratch for each joint: cosine, sine, its frame's origin (3), force, moment (3 each).
WORK = 11


@kernel(fastmath=True)
def to_parent(row: Array, c: float, s: float, a: Vector) -> Vector:
    """A vector from the frame of a joint, turned by the angle of cosine c, in its parent's."""
    x, y, z = c * a[0] - s * a[1], s * a[0] + c * a[1], a[2]
    return (
        row[1] * x + row[2] * y + row[3] * z,
        row[4] * x + row[5] * y + row[6] * z,
        row[7] * x + row[8] * y + row[9] * z,
    )


@kernel(fastmath=True)
def to_child(row: Array, c: float, s: float, a: Vector) -> Vector:
    """A vector from the frame of the parent in that of a joint."""
    x = row[1] * a[0] + row[4] * a[1] + row[7] * a[2]
    y = row[2] * a[0] + row[5] * a[1] + row[8] * a[2]
    z = row[3] * a[0] + row[6] * a[1] + row[9] * a[2]
    return c * x + s * y, c * y - s * x, z


@kernel(fastmath=True)
def place(row: Array, q: float, work: Array) -> tuple[float, float, Vector]:
    """Cosine, sine and origin in the parent's frame of a joint at q, kept in ``work`` (11,)."""
    if row[0] == 0.0:
        c, s, p = np.cos(q), np.sin(q), (row[10], row[11], row[12])
    else:
        c, s = 1.0, 0.0
        p = (row[10] + q * row[3], row[11] + q * row[6], row[12] + q * row[9])
    work[0], work[1], work[2], work[3], work[4] = c, s, p[0], p[1], p[2]
    return c, s, p


@kernel(fastmath=True)
def times_inertia(row: Array, a: Vector) -> Vector:
    """The product I a with the inertia of a body about its joint's origin."""
    return (
        row[17] * a[0] + row[18] * a[1] + row[20] * a[2],
        row[18] * a[0] + row[19] * a[1] + row[21] * a[2],
        row[20] * a[0] + row[21] * a[1] + row[22] * a[2],
    )


@kernel(fastmath=True)
def gather(rows: Array, work: Array, torque: Array) -> None:
    """Sum forces and moments from the tip to the base, and write their parts along the joints."""
    n = torque.shape[0]
    force, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(n - 1, -1, -1):
        row, own = rows[i], work[i]
        force = add(force, (own[5], own[6], own[7]))
        moment = add(moment, (own[8], own[9], own[10]))
        torque[i] = moment[2] if row[0] == 0.0 else force[2]
        if i > 0:
            force = to_parent(row, own[0], own[1], force)
            moment = to_parent(row, own[0], own[1], moment)
            moment = add(moment, cross((own[2], own[3], own[4]), force))


@kernel(fastmath=True)
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
        c, s, p = place(row, q[i], own)
        if i > 0:
            A = add(A, add(cross(dw, p), cross(w, cross(w, p))))
            w, dw = to_child(row, c, s, w), to_child(row, c, s, dw)
        A = to_child(row, c, s, A)
        if row[0] == 0.0:
            dw = (dw[0] + w[1] * qd[i], dw[1] - w[0] * qd[i], dw[2] + qdd[i])
            w = (w[0], w[1], w[2] + qd[i])
        else:
            A = (A[0] + 2.0 * w[1] * qd[i], A[1] - 2.0 * w[0] * qd[i], A[2] + qdd[i])
        h = (row[14], row[15], row[16])
        f = add(scale(row[13], A), add(cross(dw, h), cross(w, cross(w, h))))
        m = add(cross(h, A), add(times_inertia(row, dw), cross(w, times_inertia(row, w))))
        own[5], own[6], own[7] = f[0], f[1], f[2]
        own[8], own[9], own[10] = m[0], m[1], m[2]
    gather(rows, work, torque)
    for i in range(n):
        torque[i] += rows[i, 23] * qdd[i] + rows[i, 24] * qd[i]


@kernel(fastmath=True)
def gravity_kernel(rows: Array, q: Array, work: Array, G: Array) -> None:
    """Write G(q) into G (n,): what hangs on each joint pulls; ``work`` is (n, 11)."""
    n = G.shape[0]
    g = (rows[n, 0], rows[n, 1], rows[n, 2])
    for i in range(n):
        c, s, _ = place(rows[i], q[i], work[i])
        g = to_child(rows[i], c, s, g)
        work[i, 5], work[i, 6], work[i, 7] = g
    # Mass and first moment about o_i of all that joint i carries.
    mass, h = 0.0, (0.0, 0.0, 0.0)
    for i in range(n - 1, -1, -1):
        row, own = rows[i], work[i]
        h = (h[0] + row[14], h[1] + row[15], h[2] + row[16])
        mass += row[13]
        G[i] = own[5] * h[1] - own[6] * h[0] if row[0] == 0.0 else -mass * own[7]
        if i > 0:
            h = to_parent(row, own[0], own[1], h)
            h = add(h, scale(mass, (own[2], own[3], own[4])))


@kernel(fastmath=True)
def advance(
    row: Array, motion: Array, w: Vector, u: Vector, du: Vector, A: Vector, own: Array
) -> tuple[Vector, Vector, Vector, Vector]:
    """Carry w, u, u' and A from the parent's frame to that of a joint and add its own motion.

    ``motion`` (4,) holds q, q_dot, v and a of the joint.
    """
    c, s, p = place(row, motion[0], own)
    qd, v, a = motion[1], motion[2], motion[3]
    A = to_child(row, c, s, add(A, add(cross(du, p), cross(u, cross(w, p)))))
    w, u, du = to_child(row, c, s, w), to_child(row, c, s, u), to_child(row, c, s, du)
    if row[0] == 0.0:
        du = (du[0] + w[1] * v, du[1] - w[0] * v, du[2] + a)
        w, u = (w[0], w[1], w[2] + qd), (u[0], u[1], u[2] + v)
    else:
        A = (A[0] + w[1] * v + u[1] * qd, A[1] - w[0] * v - u[0] * qd, A[2] + a)
    return w, u, du, A


@kernel(fastmath=True)
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
        h = (row[14], row[15], row[16])
        f = add(scale(row[13], A), add(cross(du, h), cross(u, cross(w, h))))
        half = -0.5 * (row[17] + row[19] + row[22])
        m = add(cross(h, A), add(times_inertia(row, du), cross(w, times_inertia(row, u))))
        m = add(m, scale(half, cross(w, u)))
        own[5], own[6], own[7] = f[0], f[1], f[2]
        own[8], own[9], own[10] = m[0], m[1], m[2]
    gather(rows, work, torque)
    for i in range(n):
        torque[i] += rows[i, 23] * motion[i, 3] + rows[i, 24] * motion[i, 1]
