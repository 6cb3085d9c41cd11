"""Projection of configurations into the box that the tool may be in, by the least motion."""

import math

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array
from kinematics.jacobian import frame_and_jacobian_kernel
from kinematics.model.chain import Chain
from planning.tool_motions.tool_tolerance import RX, ToolTolerance

#: Error of a pose that counts as reached [m], [rad].
REACHED = 1e-6


def pack_tolerance(tolerance: ToolTolerance | None, *, turns: bool = False) -> Array:
    """A tolerance as the kernels read it, shape (23,).

    Args:
        tolerance: The box; None for none at all.
        turns: Whether any orientation will do, without a box.
    """
    box = np.zeros(23)
    box[12] = np.inf
    if tolerance is None:
        box[RX:6], box[6 + RX : 12] = (-np.inf, np.inf) if turns else (0.0, 0.0)
        return box
    box[:6], box[6:12], box[12] = tolerance.lower, tolerance.upper, tolerance.tilt
    if tolerance.axes is not None:
        box[13], box[14:] = 1.0, tolerance.axes.ravel()
    return box


def project(chain: Chain, nominal: Array, boxes: Array, limits: Array, joints: Array) -> Array:
    """Move configurations (k, n) into their boxes; errors that are left [m], [rad], shape (k, 2).

    Args:
        chain: The robot; its tip is the tool.
        nominal: Poses asked for, shape (k, 4, 4).
        boxes: Tolerances as ``pack_tolerance`` has them, shape (k, 23).
        limits: Lower and upper joint limits, shape (2, n).
        joints: Moved.
    """
    errors = np.empty((len(joints), 2))
    # 12 steps of Newton's method.
    project_kernel(chain.model, nominal, boxes, limits, 12, joints, errors)
    return errors


def box_errors(chain: Chain, nominal: Array, boxes: Array, joints: Array) -> Array:
    """How far the tool is out of its boxes at configurations (k, n) [m], [rad], shape (k, 2)."""
    errors, limits = np.empty((len(joints), 2)), np.empty((2, chain.n))
    q = np.ascontiguousarray(joints)
    project_kernel(chain.model, nominal, boxes, limits, 0, q, errors)
    return errors


@kernel
def project_kernel(
    model: Array, nominal: Array, boxes: Array, limits: Array, rounds: int, joints: Array,
    errors: Array,
) -> None:  # fmt: skip
    """Move configurations by the least motion that brings the tool into its tolerances.

    Args:
        model: ``Chain.model``; the tip is the tool.
        nominal: Poses asked for, shape (k, 4, 4).
        boxes: Lower and upper deviations, tilt, whether the axes stand still, and these, shape
            (k, 23).
        limits: Lower and upper joint limits, shape (2, n).
        rounds: Newton steps at most.
        joints: Configurations, moved, shape (k, n).
        errors: Errors that are left, position [m] and orientation [rad], written, shape (k, 2).
    """
    n = joints.shape[1]
    J, e, A, D = np.empty((6, n)), np.empty(6), np.empty((3, 3)), np.empty((3, 3))
    d, S, H, U = np.empty(6), np.empty((3, 3)), np.empty((6, 6)), np.empty((3, 3))
    x, change = np.empty(6), np.empty(n)
    for k in range(nominal.shape[0]):
        q, box = joints[k], boxes[k]
        for i in range(3):
            for c in range(3):
                A[i, c] = box[14 + 3 * i + c] if box[13] != 0.0 else nominal[k, i, c]
        for step in range(rounds + 1):
            B = frame_and_jacobian_kernel(model, q, -1, J)
            T = ((B[0], B[1], B[2]), (B[4], B[5], B[6]), (B[8], B[9], B[10]))
            _deviation(nominal[k], A, T, (B[3], B[7], B[11]), S, D, d)
            _error(nominal[k], A, T, box, d, S, e)
            errors[k, 0] = math.sqrt(e[0] ** 2 + e[1] ** 2 + e[2] ** 2)
            errors[k, 1] = math.sqrt(e[3] ** 2 + e[4] ** 2 + e[5] ** 2)
            # Errors below this are none [m], [rad].
            if step == rounds or max(errors[k, 0], errors[k, 1]) < 1e-10:
                break
            _free_directions(box, A, d, U)
            # Joints that would be pushed beyond their limits are left out of the step in turn.
            for _ in range(n):
                x[:] = e
                _least_motion(J, U, x, H)
                fits = True
                for j in range(n):
                    change[j] = 0.0
                    for i in range(6):
                        change[j] += J[i, j] * x[i]
                    low, high = q[j] <= limits[0, j], q[j] >= limits[1, j]
                    if (low and change[j] < 0.0) or (high and change[j] > 0.0):
                        J[:, j] = 0.0
                        fits = False
                if fits:
                    break
            for j in range(n):
                q[j] = min(max(q[j] + change[j], limits[0, j]), limits[1, j])


@kernel(allocates=False)
def _deviation(
    N: Array, A: Array, T: tuple[tuple[float, float, float], ...],
    p: tuple[float, float, float], S: Array, D: Array, d: Array,
) -> None:  # fmt: skip
    """Write the deviation (6,) of a pose from N; S and D are memory (3, 3)."""
    for i in range(3):
        d[i] = 0.0
        for k in range(3):
            d[i] += A[k, i] * (p[k] - N[k, 3])
            # S = R_T R_N^T
            S[i, k] = T[i][0] * N[k, 0] + T[i][1] * N[k, 1] + T[i][2] * N[k, 2]
    for i in range(3):
        for k in range(3):
            D[i, k] = 0.0
            for a in range(3):
                for b in range(3):
                    D[i, k] += A[a, i] * S[a, b] * A[b, k]
    d[3] = math.atan2(-D[1, 2], D[2, 2])
    d[4] = math.asin(min(1.0, max(-1.0, D[0, 2])))
    d[5] = math.atan2(-D[0, 1], D[0, 0])


@kernel
def _error(
    N: Array, A: Array, T: tuple[tuple[float, float, float], ...], box: Array, d: Array,
    S: Array, e: Array,
) -> None:  # fmt: skip
    """Write the twist (6,) from a pose to the nearest one within the box; S is memory (3, 3)."""
    c = np.empty(6)
    for k in range(6):
        value = d[k]
        if k >= 3 and math.isfinite(box[k]):
            middle = 0.5 * (box[k] + box[6 + k])
            value -= 2.0 * math.pi * math.floor((value - middle) / (2.0 * math.pi) + 0.5)
        c[k] = min(max(value, box[k]), box[6 + k])
    # Rounds in which angles are scaled down to a tilt.
    for _ in range(6):
        tilt = math.acos(min(1.0, max(-1.0, math.cos(c[3]) * math.cos(c[4]))))
        if tilt <= box[12]:
            break
        c[3] *= box[12] / tilt
        c[4] *= box[12] / tilt
    for i in range(3):
        e[i], e[3 + i] = 0.0, 0.0
        for k in range(3):
            e[i] += A[i, k] * (c[k] - d[k])
    if c[3] == d[3] and c[4] == d[4] and c[5] == d[5]:
        return
    ca, sa, cb, sb = math.cos(c[3]), math.sin(c[3]), math.cos(c[4]), math.sin(c[4])
    cc, sc = math.cos(c[5]), math.sin(c[5])
    D = (
        (cb * cc, -cb * sc, sb),
        (ca * sc + sa * sb * cc, ca * cc - sa * sb * sc, -sa * cb),
        (sa * sc - ca * sb * cc, sa * cc + ca * sb * sc, ca * cb),
    )
    # S = A D A^T, the rotation from the pose asked for to the target; then the target itself.
    for i in range(3):
        for k in range(3):
            S[i, k] = 0.0
            for a in range(3):
                for b in range(3):
                    S[i, k] += A[i, a] * D[a][b] * A[k, b]
    sine = np.zeros(3)
    cosine = -1.0
    for k in range(3):
        x = S[0, 0] * N[0, k] + S[0, 1] * N[1, k] + S[0, 2] * N[2, k]
        y = S[1, 0] * N[0, k] + S[1, 1] * N[1, k] + S[1, 2] * N[2, k]
        z = S[2, 0] * N[0, k] + S[2, 1] * N[1, k] + S[2, 2] * N[2, k]
        sine[0] += 0.5 * (T[1][k] * z - T[2][k] * y)
        sine[1] += 0.5 * (T[2][k] * x - T[0][k] * z)
        sine[2] += 0.5 * (T[0][k] * y - T[1][k] * x)
        cosine += T[0][k] * x + T[1][k] * y + T[2][k] * z
    size = math.sqrt(sine[0] ** 2 + sine[1] ** 2 + sine[2] ** 2)
    scale = math.atan2(size, 0.5 * cosine) / size if size > 1e-15 else 1.0
    for i in range(3):
        e[3 + i] = scale * sine[i]


@kernel(allocates=False)
def _free_directions(box: Array, A: Array, d: Array, U: Array) -> None:
    """Write the directions by rows that a free rotation turns about, and zeros of the others."""
    ca, sa, cb, sb = math.cos(d[3]), math.sin(d[3]), math.cos(d[4]), math.sin(d[4])
    axes = ((1.0, 0.0, 0.0), (0.0, ca, sa), (sb, -sa * cb, ca * cb))
    if not math.isfinite(box[4]):  # all three are free, and their axes may be dependent
        axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    for k in range(3):
        is_free = not math.isfinite(box[3 + k])
        for i in range(3):
            U[k, i] = 0.0
            if is_free:
                for a in range(3):
                    U[k, i] += A[i, a] * axes[k][a]


@kernel(allocates=False)
def _least_motion(J: Array, U: Array, e: Array, H: Array) -> None:
    """Replace the twist e by (J J^T + damping)^-1 e, by Cholesky's factors in H (6, 6).

    Rotations about the rows of U (3, 3) are damped so much that they may be any.
    """
    n, trace = J.shape[1], 0.0
    for i in range(6):
        for k in range(i + 1):
            H[i, k] = 0.0
            for j in range(n):
                H[i, k] += J[i, j] * J[k, j]
        trace += H[i, i]
    for i in range(3):
        for k in range(i + 1):
            for a in range(3):
                H[3 + i, 3 + k] += 1e6 * trace * U[a, i] * U[a, k]
    # Damping of a step, as part of the trace of J J^T: arms of five joints have a singular one. It
    # grows with the error, so that steps near a singularity stay small, and vanishes with it.
    square = e[0] ** 2 + e[1] ** 2 + e[2] ** 2 + e[3] ** 2 + e[4] ** 2 + e[5] ** 2
    damping = trace * (1e-9 + min(5e-2 * square, 1e-3))
    for i in range(6):
        H[i, i] += damping
        for k in range(i + 1):
            total = H[i, k]
            for j in range(k):
                total -= H[i, j] * H[k, j]
            H[i, k] = math.sqrt(max(total, 1e-300)) if i == k else total / H[k, k]
    for i in range(6):
        for j in range(i):
            e[i] -= H[i, j] * e[j]
        e[i] /= H[i, i]
    for i in range(5, -1, -1):
        for j in range(i + 1, 6):
            e[i] -= H[j, i] * e[j]
        e[i] /= H[i, i]
