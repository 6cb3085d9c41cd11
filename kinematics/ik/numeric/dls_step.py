"""One damped least-squares step inside joint limits, and the error it works on.

Chains are read from ``Chain.model``, poses as frames of twelve numbers.
"""

import math

from compiled.kernel import kernel
from compiled.simd import Conditions, Lanes, anywhere, choose
from kinematics.arrays import Array, Indices
from kinematics.frame import Frame

Error = tuple[Lanes, Lanes, Lanes, Lanes, Lanes, Lanes]
#: The lower half of a symmetric matrix of six rows, by rows.
Square = tuple[Lanes, ...]


@kernel(inline="code")
def error_kernel(B: Frame, T: Frame) -> Error:
    """The error [p_T - p_B; log(R_T R_B^T)] from frame B to T, continuous to half a turn.

    Of numbers or of vectors.
    """
    # Half of the sum of the cross products of the columns is sin(angle) times the axis.
    x = 0.5 * (B[4] * T[8] - B[8] * T[4] + B[5] * T[9] - B[9] * T[5] + B[6] * T[10] - B[10] * T[6])
    y = 0.5 * (B[8] * T[0] - B[0] * T[8] + B[9] * T[1] - B[1] * T[9] + B[10] * T[2] - B[2] * T[10])
    z = 0.5 * (B[0] * T[4] - B[4] * T[0] + B[1] * T[5] - B[5] * T[1] + B[2] * T[6] - B[6] * T[2])
    square = x * x + y * y + z * z
    cosine = 0.5 * (
        B[0] * T[0] + B[4] * T[4] + B[8] * T[8] + B[1] * T[1] + B[5] * T[5] + B[9] * T[9]
        + B[2] * T[2] + B[6] * T[6] + B[10] * T[10] - 1.0
    )  # fmt: skip
    # The angle over its sine, without branches.
    sine = math.sqrt(square)
    unit = 1.0 / max(math.sqrt(square + cosine * cosine), 1e-300)
    angle, ratio, small = quadrant_kernel(abs(cosine) * unit, sine * unit)
    behind = cosine < 0.0
    angle = choose(behind, math.pi - angle, angle)
    far = angle / max(sine, 1e-300)
    scale = choose(behind, far, choose(small, unit + unit * ratio, far))
    x, y, z = scale * x, scale * y, scale * z
    half_turn = (square <= 1e-14) & (cosine <= 0.0)
    if anywhere(half_turn):
        a, b, c = half_turn_kernel(B, T)
        x, y, z = choose(half_turn, a, x), choose(half_turn, b, y), choose(half_turn, c, z)
    return T[3] - B[3], T[7] - B[7], T[11] - B[11], x, y, z


@kernel(inline="code")
def quadrant_kernel(c: Lanes, s: Lanes) -> tuple[Lanes, Lanes, Conditions]:
    """The angle of a unit vector (c, s) in the first quadrant, in a third of the time of atan2.

    Turned back by 0, 45 or 90 degrees the sine x is at most that of 22.5, and
    asin(x) = x + x r(x^2), r the minimax fit for |x| < 0.5 of "A freely distributable C math
    library" (fdlibm, 1993).

    Returns:
        The angle [rad], r, and whether it was turned back by nothing.
    """
    small, large = s <= 0.41421356237309503 * c, s > 2.414213562373095 * c
    x = choose(small, s, choose(large, -c, (s - c) * 0.7071067811865476))
    t = x * x
    P = 7.91534994289814532176e-04 + t * 3.47933107596021167570e-05
    P = 2.01212532134862925881e-01 + t * (-4.00555345006794114027e-02 + t * P)
    P = t * (1.66666666666666657415e-01 + t * (-3.25565818622400915405e-01 + t * P))
    Q = -6.88283971605453293030e-01 + t * 7.70381505559019352791e-02
    Q = 1.0 + t * (-2.40339491173441421878e00 + t * (2.02094576023350569471e00 + t * Q))
    ratio = P / Q
    base = choose(small, 0.0, choose(large, 0.5 * math.pi, 0.25 * math.pi))
    return base + (x + x * ratio), ratio, small


@kernel(allocates=False)
def half_turn_kernel(B: Frame, T: Frame) -> tuple[Lanes, Lanes, Lanes]:
    """Pi times the axis of R_T R_B^T = m, half a turn: the largest column of (m + I) / 2."""
    m00, m11 = T[0] * B[0] + T[1] * B[1] + T[2] * B[2], T[4] * B[4] + T[5] * B[5] + T[6] * B[6]
    m22 = T[8] * B[8] + T[9] * B[9] + T[10] * B[10]
    m10 = T[4] * B[0] + T[5] * B[1] + T[6] * B[2]
    m20 = T[8] * B[0] + T[9] * B[1] + T[10] * B[2]
    m21 = T[8] * B[4] + T[9] * B[5] + T[10] * B[6]
    first, second = (m00 >= m11) & (m00 >= m22), m11 >= m22
    x = choose(first, m00 + 1.0, choose(second, m10, m20))
    y = choose(first, m10, choose(second, m11 + 1.0, m21))
    z = choose(first, m20, choose(second, m21, m22 + 1.0))
    scale = math.pi / max(math.sqrt(x * x + y * y + z * z), 1e-300)
    return scale * x, scale * y, scale * z


@kernel(inline="code")
def factor_solve_kernel(A: Square, e: Error) -> Error:
    """Solve A x = e for a positive definite A by the rows of its lower half.

    L D L^T without roots, written out, of numbers or of vectors: twice as fast as any loop over so
    few rows.
    """
    a00, a10, a11, a20, a21, a22, a30, a31, a32, a33, a40, a41, a42, a43, a44 = A[:15]
    a50, a51, a52, a53, a54, a55 = A[15:]
    d0 = 1.0 / max(a00, 1e-300)
    l1, l2, l3, l4, l5 = a10 * d0, a20 * d0, a30 * d0, a40 * d0, a50 * d0
    a11, a21, a31, a41, a51 = (
        a11 - l1 * a10, a21 - l2 * a10, a31 - l3 * a10, a41 - l4 * a10, a51 - l5 * a10,
    )  # fmt: skip
    a22, a32, a42, a52 = a22 - l2 * a20, a32 - l3 * a20, a42 - l4 * a20, a52 - l5 * a20
    a33, a43, a53 = a33 - l3 * a30, a43 - l4 * a30, a53 - l5 * a30
    a44, a54, a55 = a44 - l4 * a40, a54 - l5 * a40, a55 - l5 * a50
    d1 = 1.0 / max(a11, 1e-300)
    m2, m3, m4, m5 = a21 * d1, a31 * d1, a41 * d1, a51 * d1
    a22, a32, a42, a52 = a22 - m2 * a21, a32 - m3 * a21, a42 - m4 * a21, a52 - m5 * a21
    a33, a43, a53 = a33 - m3 * a31, a43 - m4 * a31, a53 - m5 * a31
    a44, a54, a55 = a44 - m4 * a41, a54 - m5 * a41, a55 - m5 * a51
    d2 = 1.0 / max(a22, 1e-300)
    n3, n4, n5 = a32 * d2, a42 * d2, a52 * d2
    a33, a43, a53 = a33 - n3 * a32, a43 - n4 * a32, a53 - n5 * a32
    a44, a54, a55 = a44 - n4 * a42, a54 - n5 * a42, a55 - n5 * a52
    d3 = 1.0 / max(a33, 1e-300)
    o4, o5 = a43 * d3, a53 * d3
    a44, a54, a55 = a44 - o4 * a43, a54 - o5 * a43, a55 - o5 * a53
    d4 = 1.0 / max(a44, 1e-300)
    p5 = a54 * d4
    d5 = 1.0 / max(a55 - p5 * a54, 1e-300)
    x0 = e[0]
    x1 = e[1] - l1 * x0
    x2 = e[2] - l2 * x0 - m2 * x1
    x3 = e[3] - l3 * x0 - m3 * x1 - n3 * x2
    x4 = e[4] - l4 * x0 - m4 * x1 - n4 * x2 - o4 * x3
    x5 = (e[5] - l5 * x0 - m5 * x1 - n5 * x2 - o5 * x3 - p5 * x4) * d5
    x4 = x4 * d4 - p5 * x5
    x3 = x3 * d3 - o4 * x4 - o5 * x5
    x2 = x2 * d2 - n3 * x3 - n4 * x4 - n5 * x5
    x1 = x1 * d1 - m2 * x2 - m3 * x3 - m4 * x4 - m5 * x5
    x0 = x0 * d0 - l1 * x1 - l2 * x2 - l3 * x3 - l4 * x4 - l5 * x5
    return x0, x1, x2, x3, x4, x5


@kernel(inline="code")
def diagonal_kernel(value: Lanes, zero: Lanes) -> Square:
    """``value`` times the identity; ``zero`` is a number or a vector as ``value`` is."""
    return (
        value, zero, value, zero, zero, value, zero, zero, zero, value, zero, zero, zero, zero,
        value, zero, zero, zero, zero, zero, value,
    )  # fmt: skip


@kernel(inline="code")
def add_outer_kernel(A: Square, column: Error) -> Square:
    """A + c c^T of a column c, of numbers or of vectors."""
    a00, a10, a11, a20, a21, a22, a30, a31, a32, a33, a40, a41, a42, a43, a44 = A[:15]
    a50, a51, a52, a53, a54, a55 = A[15:]
    c0, c1, c2, c3, c4, c5 = column
    return (
        a00 + c0 * c0, a10 + c1 * c0, a11 + c1 * c1, a20 + c2 * c0, a21 + c2 * c1, a22 + c2 * c2,
        a30 + c3 * c0, a31 + c3 * c1, a32 + c3 * c2, a33 + c3 * c3, a40 + c4 * c0, a41 + c4 * c1,
        a42 + c4 * c2, a43 + c4 * c3, a44 + c4 * c4, a50 + c5 * c0, a51 + c5 * c1, a52 + c5 * c2,
        a53 + c5 * c3, a54 + c5 * c4, a55 + c5 * c5,
    )  # fmt: skip


@kernel(inline="code")
def column_kernel(J: Array, j: int) -> Error:
    """Column j of J (6, n)."""
    return J[0, j], J[1, j], J[2, j], J[3, j], J[4, j], J[5, j]


@kernel(inline="code")
def project_kernel(column: Error, e: Error) -> Lanes:
    """The product of a column and an error, of numbers or of vectors."""
    j0, j1, j2, j3, j4, j5 = column
    return j0 * e[0] + j1 * e[1] + j2 * e[2] + j3 * e[3] + j4 * e[4] + j5 * e[5]


@kernel(allocates=False)
def step_within_kernel(
    J: Array, e: Array, q: Array, lower: Array, upper: Array, damping: float, free: Indices,
    out: Array,
) -> None:  # fmt: skip
    """Write the damped step from q, clipped to the limits, into ``out``.

    (J^T J + damping I) dq = J^T e over the joints that are free to move: one at a limit that e
    pushes outwards is left out. It is J^T x of (J J^T + damping I) x = e: where fewer than six are
    free, x is large across what J reaches, but not so large that rounding of J^T x, about
    1e-16 |e| / damping, would matter.

    Args:
        J: Jacobian, shape (6, n).
        e: Error, shape (6,).
        q: Configuration, shape (n,).
        lower: Lower limits, shape (n,).
        upper: Upper limits, shape (n,).
        damping: Damping term.
        free: Work array, shape (n,).
        out: The answer, shape (n,).
    """
    n, count = q.shape[0], 0
    error = (e[0], e[1], e[2], e[3], e[4], e[5])
    for j in range(n):
        out[j] = q[j]
        if q[j] <= lower[j] or q[j] >= upper[j]:
            pull = project_kernel(column_kernel(J, j), error)
            if (q[j] <= lower[j] and pull <= 0.0) or (q[j] >= upper[j] and pull >= 0.0):
                continue
        free[count] = j
        count += 1
    A = diagonal_kernel(damping, 0.0)
    for a in range(count):
        A = add_outer_kernel(A, column_kernel(J, free[a]))
    x = factor_solve_kernel(A, error)
    for a in range(count):
        j = free[a]
        step = project_kernel(column_kernel(J, j), x)
        out[j] = min(max(q[j] + step, lower[j]), upper[j])
