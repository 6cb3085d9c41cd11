"""One damped least-squares step inside joint limits, and the error it works on.

Chains are read from ``Chain.model``, poses as frames of twelve numbers.
"""

import math

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Array, Indices
from kinematics.forward import Frame
from kinematics.kernel import kernel

State = NDArray[np.uint64]
Error = tuple[float, float, float, float, float, float]


@kernel
def frame_kernel(T: Array) -> Frame:
    """The upper three rows of (4, 4) as twelve numbers."""
    return (
        T[0, 0], T[0, 1], T[0, 2], T[0, 3], T[1, 0], T[1, 1], T[1, 2], T[1, 3],
        T[2, 0], T[2, 1], T[2, 2], T[2, 3],
    )  # fmt: skip


@kernel
def error_kernel(B: Frame, T: Frame) -> Error:
    """What takes frame B to T: [p_T - p_B; log(R_T R_B^T)], continuous to half a turn."""
    # Half of the sum of the cross products of the columns is sin(angle) times the axis.
    x = 0.5 * (B[4] * T[8] - B[8] * T[4] + B[5] * T[9] - B[9] * T[5] + B[6] * T[10] - B[10] * T[6])
    y = 0.5 * (B[8] * T[0] - B[0] * T[8] + B[9] * T[1] - B[1] * T[9] + B[10] * T[2] - B[2] * T[10])
    z = 0.5 * (B[0] * T[4] - B[4] * T[0] + B[1] * T[5] - B[5] * T[1] + B[2] * T[6] - B[6] * T[2])
    square = x * x + y * y + z * z
    cosine = 0.5 * (
        B[0] * T[0] + B[4] * T[4] + B[8] * T[8] + B[1] * T[1] + B[5] * T[5] + B[9] * T[9]
        + B[2] * T[2] + B[6] * T[6] + B[10] * T[10] - 1.0
    )  # fmt: skip
    if square < 1e-8 and cosine > 0.0:
        # asin(s) / s to the eighth power of s.
        scale = 1.0 + square * (1.0 / 6.0 + square * 0.075)
        x, y, z = scale * x, scale * y, scale * z
    elif square > 1e-14:
        sine = math.sqrt(square)
        scale = math.atan2(sine, cosine) / sine
        x, y, z = scale * x, scale * y, scale * z
    else:
        x, y, z = half_turn_kernel(B, T)
    return T[3] - B[3], T[7] - B[7], T[11] - B[11], x, y, z


@kernel
def half_turn_kernel(B: Frame, T: Frame) -> tuple[float, float, float]:
    """Answer pi times the axis of R_T R_B^T = m, half a turn: the largest column of (m + I) / 2."""
    m00, m11 = T[0] * B[0] + T[1] * B[1] + T[2] * B[2], T[4] * B[4] + T[5] * B[5] + T[6] * B[6]
    m22 = T[8] * B[8] + T[9] * B[9] + T[10] * B[10]
    m10 = T[4] * B[0] + T[5] * B[1] + T[6] * B[2]
    m20 = T[8] * B[0] + T[9] * B[1] + T[10] * B[2]
    m21 = T[8] * B[4] + T[9] * B[5] + T[10] * B[6]
    if m00 >= m11 and m00 >= m22:
        x, y, z = m00 + 1.0, m10, m20
    elif m11 >= m22:
        x, y, z = m10, m11 + 1.0, m21
    else:
        x, y, z = m20, m21, m22 + 1.0
    scale = math.pi / math.sqrt(x * x + y * y + z * z)
    return scale * x, scale * y, scale * z


@kernel
def cholesky_solve_kernel(H: Array, g: Array, n: int) -> None:
    """Solve H x = g in place for the leading n rows of a positive definite H."""
    for i in range(n):
        for j in range(i):
            total = H[i, j]
            for k in range(j):
                total -= H[i, k] * H[j, k]
            # The diagonal holds reciprocals: a division costs as much as ten multiplications.
            H[i, j] = total * H[j, j]
        total = H[i, i]
        for k in range(i):
            total -= H[i, k] * H[i, k]
        H[i, i] = 1.0 / math.sqrt(max(total, 1e-300))
    for i in range(n):
        total = g[i]
        for k in range(i):
            total -= H[i, k] * g[k]
        g[i] = total * H[i, i]
    for i in range(n - 1, -1, -1):
        total = g[i]
        for k in range(i + 1, n):
            total -= H[k, i] * g[k]
        g[i] = total * H[i, i]


@kernel
def step_within_kernel(
    J: Array, e: Array, q: Array, lower: Array, upper: Array, damping: float,
    free: Indices, H: Array, g: Array, out: Array,
) -> None:  # fmt: skip
    """Write the damped step from q, clipped to the limits, into ``out`` (n,).

    (J^T J + damping I) dq = J^T e over the joints that are free to move: one at a limit that e
    pushes outwards is left out. J is (6, n), e (6,); free, H, g are room for (n,), (n, n), (n,).
    """
    n, count = q.shape[0], 0
    for j in range(n):
        out[j] = q[j]
        pull = (
            J[0, j] * e[0] + J[1, j] * e[1] + J[2, j] * e[2]
            + J[3, j] * e[3] + J[4, j] * e[4] + J[5, j] * e[5]
        )  # fmt: skip
        if (q[j] <= lower[j] and pull <= 0.0) or (q[j] >= upper[j] and pull >= 0.0):
            continue
        free[count], g[count] = j, pull
        count += 1
    for a in range(count):
        i = free[a]
        j0, j1, j2, j3, j4, j5 = J[0, i], J[1, i], J[2, i], J[3, i], J[4, i], J[5, i]
        for b in range(a + 1):
            k = free[b]
            H[a, b] = (
                j0 * J[0, k] + j1 * J[1, k] + j2 * J[2, k]
                + j3 * J[3, k] + j4 * J[4, k] + j5 * J[5, k]
            )  # fmt: skip
        H[a, a] += damping
    cholesky_solve_kernel(H, g, count)
    for a in range(count):
        j = free[a]
        out[j] = min(max(q[j] + g[a], lower[j]), upper[j])


@kernel
def uniform_kernel(state: State) -> float:
    """Next number in [0, 1) of a splitmix64 sequence, whose state is one uint64."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    x = state[0]
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    x = x ^ (x >> np.uint64(31))
    return float(x >> np.uint64(11)) * 2.0**-53
