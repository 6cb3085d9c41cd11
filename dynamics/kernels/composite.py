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

from compiled.kernel import kernel
from compiled.simd import on_stack
from compiled.sincos import TURNS, few_turns_kernel, turn_at_kernel
from compiled.vec3 import Vector, add, column, cross, dot, load, scale, store, subtract
from dynamics.model.body import (
    FIRST_MOMENT,
    INERTIA,
    MASS,
    ORIGIN_COLUMN,
    REVOLUTE,
    TYPE,
    Z_COLUMN,
    symmetric,
)
from kinematics.arrays import Array
from kinematics.frame import IDENTITY, move_kernel

# Columns of scratch for each joint.
#: First of the twelve numbers of its frame: three rows, each of the rotation and the origin.
FRAME = 12
#: First of three, as are those below: spin w that the joint alone causes, per unit of its rate.
SPIN_AXIS = 12
#: Velocity v that the joint alone causes at the point measured from, per unit of its rate.
LEVER = 15
#: Rates of change of both.
SPIN_AXIS_RATE = 18
LEVER_RATE = 21
#: Spin of the body, and velocity of its point at the origin measured from.
SPIN = 24
VELOCITY = 27
#: How many.
COMPOSITE_WORK = 30


@kernel(allocates=False)
def frames_kernel(rows: Array, q: Array, frames: Array) -> None:
    """Write the frame of every joint into the first twelve columns of ``frames`` (n, .).

    As ``kinematics.forward.frames_kernel`` has them, in base axes, but with origins measured from
    that of the last joint.
    """
    n = q.shape[0]
    turns = on_stack(TURNS)
    few = few_turns_kernel(q, turns)
    B = IDENTITY
    for i in range(n):
        c, s = turn_at_kernel(q, i, few, turns)
        B = move_kernel(rows, i, q[i], c, s, B)
        F = frames[i]
        F[0], F[1], F[2], F[3], F[4], F[5], F[6], F[7], F[8], F[9], F[10], F[11] = B
    last = (B[3], B[7], B[11])
    for i in range(n):
        frames[i, 3] -= last[0]
        frames[i, 7] -= last[1]
        frames[i, 11] -= last[2]


@kernel(fastmath=True, allocates=False)
def to_base(F: Array, a: Vector) -> Vector:
    """A vector of the frame ``F`` in base axes."""
    return (
        F[0] * a[0] + F[1] * a[1] + F[2] * a[2],
        F[4] * a[0] + F[5] * a[1] + F[6] * a[2],
        F[8] * a[0] + F[9] * a[1] + F[10] * a[2],
    )


@kernel(fastmath=True, allocates=False)
def moments(row: Array, F: Array) -> tuple[Vector, Vector, Vector]:
    """First moment and inertia (xx, xy, yy), (xz, yz, zz) of one body, in base axes."""
    m, o = row[MASS], column(F, ORIGIN_COLUMN)
    own = to_base(F, load(row, FIRST_MOMENT))
    U, T = load(row, INERTIA), load(row, INERTIA + 3)
    x, y, z = load(F, 0), load(F, 4), load(F, 8)
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


@kernel(fastmath=True, allocates=False)
def mass_matrix_kernel(rows: Array, work: Array, D: Array) -> None:
    """Write D(q) into D (n, n), for the frames in ``work`` (n, 30)."""
    n = D.shape[0]
    m, h, U, T = 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(n):
        F = work[i]
        w, v = (0.0, 0.0, 0.0), column(F, Z_COLUMN)
        if rows[i, TYPE] == REVOLUTE:
            w, v = v, cross(column(F, ORIGIN_COLUMN), v)
        store(F, SPIN_AXIS, w)
        store(F, LEVER, v)
    for k in range(n - 1, -1, -1):
        own_h, own_U, own_T = moments(rows[k], work[k])
        m, h, U, T = m + rows[k, MASS], add(h, own_h), add(U, own_U), add(T, own_T)
        w, v = load(work[k], SPIN_AXIS), load(work[k], LEVER)
        p = add(scale(m, v), cross(w, h))
        L = add(cross(h, v), symmetric(U, T, w))
        for j in range(k + 1):
            E = work[j]
            D[k, j] = dot(load(E, LEVER), p) + dot(load(E, SPIN_AXIS), L)
            D[j, k] = D[k, j]


@kernel(fastmath=True, allocates=False)
def rates(rows: Array, qd: Array, work: Array) -> None:
    """Write what joint i alone causes, its rates, and body i's spin and velocity into ``work``."""
    spin, velocity, last = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(qd.shape[0]):
        F = work[i]
        z, o = column(F, Z_COLUMN), column(F, ORIGIN_COLUMN)
        velocity = add(velocity, cross(spin, subtract(o, last))) if i > 0 else velocity
        z_rate = cross(spin, z)
        if rows[i, TYPE] == REVOLUTE:
            w, v, w_rate = z, cross(o, z), z_rate
            v_rate = add(cross(velocity, z), cross(o, z_rate))
            spin = add(spin, scale(qd[i], z))
        else:
            w, v, w_rate, v_rate = (0.0, 0.0, 0.0), z, (0.0, 0.0, 0.0), z_rate
            velocity = add(velocity, scale(qd[i], z))
        here = subtract(velocity, cross(spin, o))
        store(F, SPIN_AXIS, w)
        store(F, LEVER, v)
        store(F, SPIN_AXIS_RATE, w_rate)
        store(F, LEVER_RATE, v_rate)
        store(F, SPIN, spin)
        store(F, VELOCITY, here)
        last = o


@kernel(fastmath=True, allocates=False)
def coriolis_kernel(rows: Array, qd: Array, work: Array, C: Array) -> None:
    """Write C(q, q_dot) into C (n, n), for the frames in ``work`` (n, 30)."""
    n = C.shape[0]
    rates(rows, qd, work)
    m, h, U, T = 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    h_rate = (0.0, 0.0, 0.0)
    Wx, Wy, Wz = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(n - 1, -1, -1):
        F, mass = work[k], rows[k, MASS]
        spin, here = load(F, SPIN), load(F, VELOCITY)
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
        w, v = load(F, SPIN_AXIS), load(F, LEVER)
        w_rate, v_rate = load(F, SPIN_AXIS_RATE), load(F, LEVER_RATE)
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
            wj, vj = load(E, SPIN_AXIS), load(E, LEVER)
            C[j, k] = dot(vj, f) + dot(wj, t)
            if j < k:
                C[k, j] = dot(a, load(E, LEVER_RATE)) + dot(b, load(E, SPIN_AXIS_RATE)) + dot(c, wj)
