"""D(q) and C(q, q_dot) from the moments of what each joint carries.

Everything is in base axes, measured from the origin of the last joint, so that a robot far from
its base loses no digits. With m, h, I the mass, first moment and inertia of what joint k and all
beyond carry, and (w_k, v_k) the motion that joint k alone causes at the point measured from,

    d_kj = v_j . (m v_k + w_k x h) + w_j . (h x v_k + I w_k),    j <= k.

Of a point mass m at r(q) the Christoffel symbols are c_ijk = m r_k . r_ij (subscripts: partial
derivatives), so its C is m J^T J_dot; a robot is a sum of point masses, so

    C = integral J_p^T J_p_dot dm    over all points p of all bodies,

which makes D_dot - 2 C skew-symmetric. With h' = int p' dm and W = int p' p^T dm besides,
C_kj = v_k . f_j + w_k . n_j for the moments of the farther one of the two joints, where

    f_j = m v_j' + w_j' x h + w_j x h',    n_j = h x v_j' + I w_j' + (tr W - W) w_j.
"""

import numpy as np

from kinematics.arrays import Array
from kinematics.compiled.kernel import kernel
from kinematics.vec3 import Vector, add, cross, dot, scale, subtract

#: Columns of scratch for each joint: rotation (9) and origin (3) of its frame, then what its column
#: of D or C needs.
FRAME, COMPOSITE_WORK = 12, 30


@kernel(fastmath=True)
def frames_kernel(rows: Array, q: Array, frames: Array) -> None:
    """Write rotation (9) and origin (3) of every joint frame into the columns of ``frames`` (n, .).

    Origins are measured from that of the last joint.
    """
    n = q.shape[0]
    for i in range(n):
        row, F = rows[i], frames[i]
        c, s, d = 1.0, 0.0, 0.0
        if row[0] == 0.0:
            c, s = np.cos(q[i]), np.sin(q[i])
        else:
            d = q[i]
        for k in range(3):
            if i == 0:
                x, y, z, p = row[1 + 3 * k], row[2 + 3 * k], row[3 + 3 * k], 0.0
            else:
                B = frames[i - 1]
                b0, b1, b2 = B[3 * k], B[3 * k + 1], B[3 * k + 2]
                x = b0 * row[1] + b1 * row[4] + b2 * row[7]
                y = b0 * row[2] + b1 * row[5] + b2 * row[8]
                z = b0 * row[3] + b1 * row[6] + b2 * row[9]
                p = b0 * row[10] + b1 * row[11] + b2 * row[12] + B[9 + k]
            F[3 * k] = x * c + y * s
            F[3 * k + 1] = y * c - x * s
            F[3 * k + 2] = z
            F[9 + k] = p + z * d
    last = (frames[n - 1, 9], frames[n - 1, 10], frames[n - 1, 11])
    for i in range(n):
        frames[i, 9] -= last[0]
        frames[i, 10] -= last[1]
        frames[i, 11] -= last[2]


@kernel(fastmath=True)
def turn(F: Array, a: Vector) -> Vector:
    """A vector of the frame ``F`` in base axes."""
    return (
        F[0] * a[0] + F[1] * a[1] + F[2] * a[2],
        F[3] * a[0] + F[4] * a[1] + F[5] * a[2],
        F[6] * a[0] + F[7] * a[1] + F[8] * a[2],
    )


@kernel(fastmath=True)
def symmetric(U: Vector, T: Vector, a: Vector) -> Vector:
    """The product with a symmetric matrix of rows (U0, U1, T0), (U1, U2, T1), (T0, T1, T2)."""
    return (
        U[0] * a[0] + U[1] * a[1] + T[0] * a[2],
        U[1] * a[0] + U[2] * a[1] + T[1] * a[2],
        T[0] * a[0] + T[1] * a[1] + T[2] * a[2],
    )


@kernel(fastmath=True)
def moments(row: Array, F: Array) -> tuple[Vector, Vector, Vector]:
    """First moment and inertia (xx, xy, yy), (xz, yz, zz) of one body, in base axes."""
    m, o = row[13], (F[9], F[10], F[11])
    own = turn(F, (row[14], row[15], row[16]))
    U, T = (row[17], row[18], row[19]), (row[20], row[21], row[22])
    x, y, z = (F[0], F[1], F[2]), (F[3], F[4], F[5]), (F[6], F[7], F[8])
    Ix, Iy, Iz = symmetric(U, T, x), symmetric(U, T, y), symmetric(U, T, z)
    # About another point: + m (|o|^2 E - o o^T) + 2 (o.h) E - o h^T - h o^T.
    d = m * dot(o, o) + 2.0 * dot(o, own)
    g = add(own, scale(m, o))
    xx = dot(x, Ix) + d - o[0] * g[0] - own[0] * o[0]
    yy = dot(y, Iy) + d - o[1] * g[1] - own[1] * o[1]
    zz = dot(z, Iz) + d - o[2] * g[2] - own[2] * o[2]
    xy = dot(x, Iy) - o[0] * g[1] - own[0] * o[1]
    xz = dot(x, Iz) - o[0] * g[2] - own[0] * o[2]
    yz = dot(y, Iz) - o[1] * g[2] - own[1] * o[2]
    return g, (xx, xy, yy), (xz, yz, zz)


@kernel(fastmath=True)
def screw(row: Array, F: Array) -> tuple[Vector, Vector]:
    """Spin and velocity that a joint alone causes at the point measured from."""
    z = (F[2], F[5], F[8])
    if row[0] == 0.0:
        return z, cross((F[9], F[10], F[11]), z)
    return (0.0, 0.0, 0.0), z


@kernel(fastmath=True)
def mass_matrix_kernel(rows: Array, work: Array, D: Array) -> None:
    """Write D(q) into D (n, n), for the frames in ``work`` (n, 30)."""
    n = D.shape[0]
    m, h, U, T = 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(n):
        w, v = screw(rows[i], work[i])
        work[i, 12], work[i, 13], work[i, 14] = w
        work[i, 15], work[i, 16], work[i, 17] = v
    for k in range(n - 1, -1, -1):
        own_h, own_U, own_T = moments(rows[k], work[k])
        m, h, U, T = m + rows[k, 13], add(h, own_h), add(U, own_U), add(T, own_T)
        F = work[k]
        w, v = (F[12], F[13], F[14]), (F[15], F[16], F[17])
        p = add(scale(m, v), cross(w, h))
        L = add(cross(h, v), symmetric(U, T, w))
        for j in range(k + 1):
            E = work[j]
            D[k, j] = (
                E[15] * p[0] + E[16] * p[1] + E[17] * p[2]
                + E[12] * L[0] + E[13] * L[1] + E[14] * L[2]
            )  # fmt: skip
            D[j, k] = D[k, j]


@kernel(fastmath=True)
def rates(rows: Array, qd: Array, work: Array) -> None:
    """Write w_i, w_i', v_i', the spin and velocity of body i, and v_i into columns 12 to 29.

    The velocity is that of the body's point at the origin measured from.
    """
    spin, velocity, last = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(qd.shape[0]):
        F = work[i]
        z, o = (F[2], F[5], F[8]), (F[9], F[10], F[11])
        velocity = add(velocity, cross(spin, subtract(o, last))) if i > 0 else velocity
        z_rate = cross(spin, z)
        if rows[i, 0] == 0.0:
            w, v, w_rate = z, cross(o, z), z_rate
            v_rate = add(cross(velocity, z), cross(o, z_rate))
            spin = add(spin, scale(qd[i], z))
        else:
            w, v, w_rate, v_rate = (0.0, 0.0, 0.0), z, (0.0, 0.0, 0.0), z_rate
            velocity = add(velocity, scale(qd[i], z))
        here = subtract(velocity, cross(spin, o))
        for k in range(3):
            F[12 + k], F[15 + k], F[18 + k] = w[k], w_rate[k], v_rate[k]
            F[21 + k], F[24 + k], F[27 + k] = spin[k], here[k], v[k]
        last = o


@kernel(fastmath=True)
def coriolis_kernel(rows: Array, qd: Array, work: Array, C: Array) -> None:
    """Write C(q, q_dot) into C (n, n), for the frames in ``work`` (n, 30)."""
    n = C.shape[0]
    rates(rows, qd, work)
    m, h, U, T = 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    h_rate = (0.0, 0.0, 0.0)
    Wx, Wy, Wz = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(n - 1, -1, -1):
        F, mass = work[k], rows[k, 13]
        spin, here = (F[21], F[22], F[23]), (F[24], F[25], F[26])
        own_h, own_U, own_T = moments(rows[k], F)
        m, h, U, T = m + mass, add(h, own_h), add(U, own_U), add(T, own_T)
        h_rate = add(h_rate, add(scale(mass, here), cross(spin, own_h)))
        # W = int p' p^T = here h^T + [spin] S with S = tr(I)/2 - I, column by column.
        half = 0.5 * (own_U[0] + own_U[2] + own_T[2])
        X = cross(spin, (half - own_U[0], -own_U[1], -own_T[0]))
        Y = cross(spin, (-own_U[1], half - own_U[2], -own_T[1]))
        Z = cross(spin, (-own_T[0], -own_T[1], half - own_T[2]))
        Wx = add(Wx, add(X, scale(own_h[0], here)))
        Wy = add(Wy, add(Y, scale(own_h[1], here)))
        Wz = add(Wz, add(Z, scale(own_h[2], here)))
        trace = Wx[0] + Wy[1] + Wz[2]
        w, v = (F[12], F[13], F[14]), (F[27], F[28], F[29])
        w_rate, v_rate = (F[15], F[16], F[17]), (F[18], F[19], F[20])
        # What column k asks of all joints before it ...
        Ww = add(scale(w[0], Wx), add(scale(w[1], Wy), scale(w[2], Wz)))
        f = add(scale(m, v_rate), add(cross(w_rate, h), cross(w, h_rate)))
        t = add(cross(h, v_rate), symmetric(U, T, w_rate))
        t = add(t, subtract(scale(trace, w), Ww))
        # ... and what row k asks of their columns.
        a = add(scale(m, v), cross(w, h))
        b = add(cross(h, v), symmetric(U, T, w))
        WTw = (dot(Wx, w), dot(Wy, w), dot(Wz, w))
        c = add(cross(h_rate, v), subtract(scale(trace, w), WTw))
        for j in range(k + 1):
            E = work[j]
            wj, vj = (E[12], E[13], E[14]), (E[27], E[28], E[29])
            C[j, k] = dot(vj, f) + dot(wj, t)
            if j < k:
                C[k, j] = (
                    a[0] * E[18] + a[1] * E[19] + a[2] * E[20]
                    + b[0] * E[15] + b[1] * E[16] + b[2] * E[17]
                    + dot(c, wj)
                )  # fmt: skip
