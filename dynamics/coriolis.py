"""The Coriolis matrix C(q, q_dot) of the Christoffel symbols, exact.

Of a point mass m at r(q) the Christoffel symbols are c_ijk = m r_k . r_ij (subscripts: partial
derivatives), so its C is m J^T J_dot; a robot is a sum of point masses, so

    C = integral J_p^T J_p_dot dm    over all points p of all bodies,

which makes D_dot - 2 C skew-symmetric. Column j of J_p is the velocity v_j + w_j x p of the point
in the motion of joint j alone, taken about a fixed point from which p is measured. With the
moments of what moves with both joints,

    m = int dm,  h = int p dm,  S = int p p^T dm,  h' = int p' dm,  W = int p' p^T dm,

the entry is C_kj = v_k . f + w_k . n, where

    f = m v_j' + w_j' x h + w_j x h',
    n = h x v_j' + (tr S - S) w_j' + (tr W - W) w_j.
"""

import numpy as np
from numpy.typing import ArrayLike

from dynamics.batch import stacked
from dynamics.body import Bodies, bodies
from dynamics.vector import (
    Vector,
    add,
    apply,
    axis,
    cross,
    dot,
    origin,
    rotate_tensor,
    row,
    scale,
    subtract,
)
from kinematics.chain import Array, Chain
from kinematics.forward import forward_kernel
from kinematics.kernel import kernel

#: Rows of the moments of one body, each of three: S, W, h, h', (m, -, -).
MOMENT_ROWS = 9
#: Rows of one joint's motion: w, v and their rates.
SCREW_ROWS = 4


@kernel
def add_body_moments(
    body: Array, tensor: Array, spin: Vector, center: Vector, velocity: Vector
) -> None:
    """Add the moments of one body of mass ``body[8, 0]`` to ``body`` (9, 3).

    ``tensor`` is its inertia about the centre of mass, in base axes; with E = tr(I)/2 - I the
    moments are S = E + m c c^T and W = [w] E + m c' c^T.
    """
    mass = body[8, 0]
    half = 0.5 * (tensor[0, 0] + tensor[1, 1] + tensor[2, 2])
    for j in range(3):
        # Column j of E, which is symmetric.
        E = (
            (half if j == 0 else 0.0) - tensor[0, j],
            (half if j == 1 else 0.0) - tensor[1, j],
            (half if j == 2 else 0.0) - tensor[2, j],
        )
        turned = cross(spin, E)
        for i in range(3):
            body[i, j] += E[i] + mass * center[i] * center[j]
            body[3 + i, j] += turned[i] + mass * velocity[i] * center[j]
        body[6, j] += mass * center[j]
        body[7, j] += mass * velocity[j]


@kernel
def set_screw(screw: Array, w: Vector, v: Vector, w_rate: Vector, v_rate: Vector) -> None:
    """Write w, v, w', v' into the rows of ``screw`` (4, 3)."""
    for k in range(3):
        screw[0, k], screw[1, k] = w[k], v[k]
        screw[2, k], screw[3, k] = w_rate[k], v_rate[k]


@kernel
def reaction(moments: Array, screw: Array) -> tuple[Vector, Vector]:
    """Force f and moment n of one joint's motion on bodies of these ``moments`` (9, 3)."""
    w, w_rate, v_rate = row(screw, 0), row(screw, 2), row(screw, 3)
    h, h_rate = row(moments, 6), row(moments, 7)
    f = add(
        add(scale(moments[8, 0], v_rate), cross(w_rate, h)),
        cross(w, h_rate),
    )
    S, W = moments[0:3], moments[3:6]
    trace_S = S[0, 0] + S[1, 1] + S[2, 2]
    trace_W = W[0, 0] + W[1, 1] + W[2, 2]
    n = add(
        cross(h, v_rate),
        add(
            subtract(scale(trace_S, w_rate), apply(S, w_rate)),
            subtract(scale(trace_W, w), apply(W, w)),
        ),
    )
    return f, n


@kernel
def coriolis_kernel(
    bodies: Bodies, state: Array, frames: Array, moments: Array, screws: Array, C: Array
) -> None:
    """Write C(q, q_dot) into C (n, n).

    ``state`` (2, n) holds q and q_dot; ``frames`` (n, 4, 4), ``moments`` (n + 1, 9, 3) and
    ``screws`` (n, 4, 3) are scratch.
    """
    n = C.shape[0]
    forward_kernel(bodies.types, bodies.offsets, state[0], frames)
    # Measured from the last joint, so that a robot far from its base loses no digits.
    about = origin(frames, n - 1)
    spin, velocity = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    last = (0.0, 0.0, 0.0)
    zero = (0.0, 0.0, 0.0)
    for i in range(n):
        z, o, qd = axis(frames, i), subtract(origin(frames, i), about), state[1, i]
        velocity = add(velocity, cross(spin, subtract(o, last)))
        z_rate = cross(spin, z)
        if bodies.types[i] == 0:
            v_rate = add(cross(velocity, z), cross(o, z_rate))
            set_screw(screws[i], z, cross(o, z), z_rate, v_rate)
            spin = add(spin, scale(qd, z))
        else:
            set_screw(screws[i], zero, z, zero, z_rate)
            velocity = add(velocity, scale(qd, z))
        arm = apply(frames[i], row(bodies.centers, i))
        body = moments[i]
        body[:] = 0.0
        body[8, 0] = bodies.masses[i]
        rotate_tensor(frames[i], bodies.tensors[i], moments[n])
        at, speed = add(o, arm), add(velocity, cross(spin, arm))
        add_body_moments(body, moments[n], spin, at, speed)
        last = o
    for j in range(n - 1, -1, -1):
        if j < n - 1:
            moments[j] += moments[j + 1]
        for k in range(n):
            f, m = reaction(moments[max(j, k)], screws[j])
            C[k, j] = dot(row(screws[k], 1), f) + dot(row(screws[k], 0), m)


@kernel
def coriolis_batch_kernel(bodies: Bodies, state: Array, C: Array) -> None:
    """``coriolis_kernel`` for a batch: state (m, 2, n), C (m, n, n)."""
    n = state.shape[2]
    frames = np.empty((n, 4, 4))
    moments, screws = np.empty((n + 1, MOMENT_ROWS, 3)), np.empty((n, SCREW_ROWS, 3))
    for k in range(state.shape[0]):
        coriolis_kernel(bodies, state[k], frames, moments, screws, C[k])


def coriolis_matrix(chain: Chain, q: ArrayLike, qd: ArrayLike) -> Array:
    """Coriolis matrix C_kj = sum_i c_ijk q_dot_i of the Christoffel symbols of D.

    c_ijk = (d_kj,i + d_ki,j - d_ij,k) / 2, so D_dot - 2 C is skew-symmetric.

    Args:
        chain: The robot.
        q: Positions, (n,) or (..., n) [rad or m].
        qd: Velocities, (n,) or (..., n) [rad/s or m/s].

    Returns:
        Shape (..., n, n).

    Raises:
        InvalidRobotState: A vector has the wrong length, is not finite or fits no other's batch.
        MissingInertia: Some joint carries nothing that has an inertia.
    """
    packed = bodies(chain)
    state, lead = stacked(chain, joints=q, velocities=qd)
    C = np.empty((state.shape[0], chain.n, chain.n))
    coriolis_batch_kernel(packed, state, C)
    return C.reshape(*lead, chain.n, chain.n)
