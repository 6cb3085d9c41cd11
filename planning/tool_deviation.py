"""Deviation of the tool from a line or an arc, for planners, bounded for every instant.

About the middle t of a cell of time, joint j has velocity v_j, over the cell at most V_j and at
most the acceleration A_j, from the coefficients of its polynomial. With R_j a bound of the tool's
distance from axis j (what it may move within the cell included), the tool's acceleration is at most

    P = sum_j R_j A_j + sum_ij R_max(i,j) V_i V_j          (revolute; a slide has 1 for R_j, and
                                                            turns before it only),

since d2p / dq_i dq_j = z_i x (z_j x (p - o_j)) for i <= j; the tool's angular acceleration is at
most W = sum_j A_j + sum_(i<j) V_i V_j. So the deviation e of the tool across a line, of which value
and rate are known in the middle, stays below max |e +- h e'| + P h^2 / 2 all over the cell of half
width h; on an arc e = (distance from the axis - radius, height), whose second derivative adds
|p'|^2 / distance. An angle between two orientations changes at most by their relative angular
velocity. Cells are halved until the bound is sharp or a deviation beyond what is allowed is found.
The proof bounds deviations by code of its own, ``planning.proof.tool_deviation``.
"""

import math

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, Indices
from kinematics.chain import Chain
from kinematics.compiled.kernel import kernel
from kinematics.polynomial import shift_kernel
from planning.proof.joint_frames import forward_kernel
from planning.tool_motion import ToolMotion

#: A bound is sharp that is at most this much above what was found, or below this share of what is
#: allowed.
_SHARP = 1.25
_SMALL = 0.1
#: Halvings of a piece; a cell of a millionth of a second has told all there is.
_MAX_DEPTH = 40


def piece_deviations(
    chain: Chain,
    breaks: Array,
    coefficients: Array,
    motion: ToolMotion,
    tolerances: tuple[float, float],
) -> tuple[Array, NDArray[np.bool_], Array]:
    """Bounds of the deviation of every piece of a piecewise polynomial from a tool's motion.

    Args:
        chain: The robot; its tip is the tool.
        breaks: Shape (m + 1,), of time or any other parameter.
        coefficients: Shape (m, n, k), ascending.
        motion: Where the tool is to be.
        tolerances: What is allowed [m], [rad]; infinite where it is free.

    Returns:
        Bounds of position [m] and orientation [rad], shape (m, 2), of a piece that goes too far
        what was found; whether each piece is proved, (m,); where each is farthest off, (m,).
    """
    tip, m = chain.tip, len(breaks) - 1
    bounds, fine, where = np.zeros((m, 2)), np.zeros(m), np.zeros(m)
    deviation_kernel(
        chain.joint_types, chain.offsets, tip.T_joint_link, tip.joint,
        np.ascontiguousarray(breaks), np.ascontiguousarray(coefficients), motion.numbers,
        np.array(tolerances), bounds, fine, where,
    )  # fmt: skip
    return bounds, fine != 0.0, where


@kernel
def _norm3(a: float, b: float, c: float) -> float:
    return math.sqrt(a * a + b * b + c * c)


@kernel
def _spread(e: Array, rate: Array, h: float) -> float:
    """The larger of |e + h e'| and |e - h e'|."""
    plus, minus = 0.0, 0.0
    for k in range(3):
        plus += (e[k] + h * rate[k]) ** 2
        minus += (e[k] - h * rate[k]) ** 2
    return math.sqrt(max(plus, minus))


@kernel
def _nominal(m: Array, s: float, R: Array) -> None:
    """Write exp(s theta [a]) R_0 of a motion's numbers into R (3, 3)."""
    angle = s * m[16]
    c, v = math.cos(angle), math.sin(angle)
    for column in range(3):
        x, y, z = m[4 + column], m[7 + column], m[10 + column]
        along = (m[13] * x + m[14] * y + m[15] * z) * (1.0 - c)
        R[0, column] = c * x + v * (m[14] * z - m[15] * y) + along * m[13]
        R[1, column] = c * y + v * (m[15] * x - m[13] * z) + along * m[14]
        R[2, column] = c * z + v * (m[13] * y - m[14] * x) + along * m[15]


@kernel
def _angle_between(A: Array, B: Array) -> float:
    """Angle of A^T B, (3, 3) each, from |A - B| = 2 sqrt(2) sin(angle / 2): exact where small."""
    square = 0.0
    for i in range(3):
        for j in range(3):
            square += (A[i, j] - B[i, j]) ** 2
    return 2.0 * math.asin(min(1.0, math.sqrt(square / 8.0)))


@kernel
def _twist_angle(m: Array, R: Array) -> float:
    """Angle about the axis a that R R_0^T contains, in (-pi, pi]."""
    # Of D = R R_0^T: sine from its skew part along a, cosine from what it does across a.
    trace, x, y, z = 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        trace += R[0, k] * m[4 + k] + R[1, k] * m[7 + k] + R[2, k] * m[10 + k]
        x += R[2, k] * m[7 + k] - R[1, k] * m[10 + k]
        y += R[0, k] * m[10 + k] - R[2, k] * m[4 + k]
        z += R[1, k] * m[4 + k] - R[0, k] * m[7 + k]
    sine = 0.5 * (x * m[13] + y * m[14] + z * m[15])
    return math.atan2(sine, 0.5 * (trace - 1.0))


@kernel
def deviation_kernel(
    types: Indices, offsets: Array, T_joint_tip: Array, last: int, breaks: Array,
    coefficients: Array, m: Array, tolerances: Array, bounds: Array, fine: Array, where: Array,
) -> None:  # fmt: skip
    """Kernel of ``piece_deviations``; ``fine`` is 1 where a piece is proved."""
    count, n, size = coefficients.shape
    c = np.empty((n, size))
    state = np.zeros(10)
    work = np.empty((8, max(n, 4)))
    frames = np.empty((n, 4, 4))
    stack = np.empty((_MAX_DEPTH + 2, 3))
    for piece in range(count):
        length = breaks[piece + 1] - breaks[piece]
        stack[0, 0], stack[0, 1], stack[0, 2] = 0.0, length, 0.0
        top = 1
        fine[piece] = 1.0
        worst_p, worst_r, highest = 0.0, 0.0, -1.0
        while top > 0:
            top -= 1
            low, high, depth = stack[top, 0], stack[top, 1], stack[top, 2]
            at, h = 0.5 * (low + high), 0.5 * (high - low)
            for j in range(n):
                shift_kernel(coefficients[piece, j], at, c[j])
            cell_kernel(types, offsets, T_joint_tip, last, c, h, m, frames, work, state)
            now_p, now_r, upper_p, upper_r = state[0], state[1], state[2], state[3]
            if now_p > tolerances[0] or now_r > tolerances[1]:
                fine[piece] = 0.0
                worst_p, worst_r = max(worst_p, now_p), max(worst_r, now_r)
                where[piece] = breaks[piece] + at
                break
            enough_p = max(_SMALL * tolerances[0], _SHARP * max(now_p, worst_p))
            enough_r = max(_SMALL * tolerances[1], _SHARP * max(now_r, worst_r))
            sharp = upper_p <= enough_p and upper_r <= enough_r
            allowed = upper_p <= tolerances[0] and upper_r <= tolerances[1]
            if sharp and allowed:
                worst_p, worst_r = max(worst_p, upper_p), max(worst_r, upper_r)
                share = max(upper_p / tolerances[0], upper_r / tolerances[1])
                if share > highest:
                    highest, where[piece] = share, breaks[piece] + at
                continue
            if depth >= _MAX_DEPTH:
                fine[piece] = 0.0
                worst_p, worst_r = max(worst_p, upper_p), max(worst_r, upper_r)
                where[piece] = breaks[piece] + at
                break
            stack[top, 0], stack[top, 1], stack[top, 2] = at, high, depth + 1.0
            stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = low, at, depth + 1.0
            top += 2
        bounds[piece, 0], bounds[piece, 1] = worst_p, worst_r


@kernel
def cell_kernel(
    types: Indices, offsets: Array, T_joint_tip: Array, last: int, c: Array, h: float, m: Array,
    frames: Array, work: Array, state: Array,
) -> None:  # fmt: skip
    """Deviations in the middle of a cell, ``state[:2]``, and bounds over it, ``state[2:4]``.

    ``c`` (n, k) holds the coefficients about the middle. ``state[6]`` is the angle where the last
    cell's middle was, which tells this one's whole turns. Further: bounds of the tool's
    accelerations ``state[4:6]``, and place, pace and a bound of its change ``state[7:10]``.
    """
    R, N = np.empty((3, 3)), np.empty((3, 3))
    tip_motion_kernel(types, offsets, T_joint_tip, last, c, h, frames, work, R, state)
    w = work[5]
    if m[0] == 0.0:
        _line_kernel(m, h, work, R, state)
    else:
        _arc_kernel(m, h, work, state)
    s, pace, bend = state[7], state[8], state[9]
    _nominal(m, s, N)
    state[1] = _angle_between(N, R)
    state[3] = np.inf
    if state[2] < np.inf:
        relative = _norm3(
            w[0] - m[16] * pace * m[13], w[1] - m[16] * pace * m[14], w[2] - m[16] * pace * m[15]
        )
        state[3] = state[1] + relative * h + 0.5 * (state[5] + m[16] * bend) * h * h
        if m[0] == 0.0 and m[29] == 0.0:
            reach = abs(pace) * h
            state[3] += max(0.0, reach - s, s + reach - 1.0) * m[16]
            state[1] += max(0.0, -s, s - 1.0) * m[16]


@kernel
def tip_motion_kernel(
    types: Indices, offsets: Array, T_joint_tip: Array, last: int, c: Array, h: float,
    frames: Array, work: Array, R: Array, state: Array,
) -> None:  # fmt: skip
    """Write the tip's place ``work[3]``, velocities ``work[4]``, ``work[5]`` and rotation R.

    Bounds of its acceleration and angular acceleration over the cell go to ``state[4:6]``.
    """
    n, size = c.shape
    q, V, A, p, v, w = work[0], work[1], work[2], work[3], work[4], work[5]
    for j in range(n):
        q[j] = c[j, 0]
        total, power = 0.0, 1.0
        for i in range(2, size):
            total += i * (i - 1) * abs(c[j, i]) * power
            power *= h
        A[j] = total
        V[j] = (abs(c[j, 1]) if size > 1 else 0.0) + total * h
    forward_kernel(types, offsets, q[:n], frames)
    for row in range(3):
        p[row] = T_joint_tip[row, 3]
        v[row], w[row] = 0.0, 0.0
        for column in range(3):
            R[row, column] = T_joint_tip[row, column]
    if last >= 0:
        F = frames[last]
        for row in range(3):
            p[row] = F[row, 3]
            for k in range(3):
                p[row] += F[row, k] * T_joint_tip[k, 3]
            for column in range(3):
                R[row, column] = 0.0
                for k in range(3):
                    R[row, column] += F[row, k] * T_joint_tip[k, column]
    second, turning, moved = 0.0, 0.0, 0.0
    for j in range(last, -1, -1):
        F = frames[j]
        zx, zy, zz = F[0, 2], F[1, 2], F[2, 2]
        speed = c[j, 1] if size > 1 else 0.0
        before = 0.0
        for i in range(j):
            if types[i] == 0:
                before += V[i]
        if types[j] == 1:
            second += A[j] + 2.0 * V[j] * before
            moved += V[j] * h
            v[0] += speed * zx
            v[1] += speed * zy
            v[2] += speed * zz
            continue
        dx, dy, dz = p[0] - F[0, 3], p[1] - F[1, 3], p[2] - F[2, 3]
        cx, cy, cz = zy * dz - zz * dy, zz * dx - zx * dz, zx * dy - zy * dx
        lever = _norm3(cx, cy, cz) + moved
        v[0] += speed * cx
        v[1] += speed * cy
        v[2] += speed * cz
        w[0] += speed * zx
        w[1] += speed * zy
        w[2] += speed * zz
        second += lever * (A[j] + V[j] * V[j] + 2.0 * V[j] * before)
        turning += A[j] + V[j] * before
        moved += lever * V[j] * h
    state[4], state[5] = second, turning


@kernel
def _line_kernel(m: Array, h: float, work: Array, R: Array, state: Array) -> None:
    """Position deviation from a line for ``cell_kernel``."""
    p, v, w, e, rate = work[3], work[4], work[5], work[6], work[7]
    second, length = state[4], m[29]
    x, along = 0.0, 0.0
    for k in range(3):
        x += m[17 + k] * (p[k] - m[1 + k])
        along += m[17 + k] * v[k]
    for k in range(3):
        e[k] = p[k] - m[1 + k] - x * m[17 + k]
        rate[k] = v[k] - along * m[17 + k]
    state[0] = _norm3(e[0], e[1], e[2])
    state[2] = _spread(e, rate, h) + 0.5 * second * h * h
    if length > 0.0:
        reach = abs(along) * h + 0.5 * second * h * h
        state[0] = math.hypot(state[0], max(0.0, -x, x - length))
        state[2] = math.hypot(state[2], max(0.0, reach - x, x + reach - length))
        state[7], state[8], state[9] = x / length, along / length, second / length
        return
    # A turn on the spot: the place that fits best, at the pace that does.
    state[7], state[8], state[9] = 0.0, 0.0, 0.0
    if m[16] > 0.0:
        turned = _twist_angle(m, R)
        turned += 2.0 * math.pi * math.floor((state[6] - turned) / (2.0 * math.pi) + 0.5)
        state[6] = turned
        state[7] = turned / m[16]
        state[8] = (m[13] * w[0] + m[14] * w[1] + m[15] * w[2]) / m[16]


@kernel
def _arc_kernel(m: Array, h: float, work: Array, state: Array) -> None:
    """Position deviation from an arc for ``cell_kernel``."""
    p, v, e, rate = work[3], work[4], work[6], work[7]
    second, radius, sweep = state[4], m[29], m[30]
    a, b, z, va, vb, vz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        r = p[k] - m[26 + k]
        a += m[17 + k] * r
        b += m[20 + k] * r
        z += m[23 + k] * r
        va += m[17 + k] * v[k]
        vb += m[20 + k] * v[k]
        vz += m[23 + k] * v[k]
    distance = math.sqrt(a * a + b * b)
    phi = math.atan2(b, a)
    phi += 2.0 * math.pi * math.floor((state[6] - phi) / (2.0 * math.pi) + 0.5)
    state[6] = phi
    state[0] = math.hypot(distance - radius, z)
    state[0] = math.hypot(state[0], radius * max(0.0, -phi, phi - sweep))
    state[2], state[7], state[8], state[9] = np.inf, phi / sweep, 0.0, 0.0
    fastest = _norm3(v[0], v[1], v[2]) + second * h
    least = distance - fastest * h
    if least <= 0.5 * distance:
        # Too wide a cell to tell anything: it is halved.
        return
    e[0], e[1], e[2] = distance - radius, z, 0.0
    rate[0], rate[1], rate[2] = (a * va + b * vb) / distance, vz, 0.0
    curved = second + fastest * fastest / least
    across = (a * vb - b * va) / (distance * distance)
    faster = (second + 2.0 * fastest * fastest / least) / least
    reach = abs(across) * h + 0.5 * faster * h * h
    over = radius * max(0.0, reach - phi, phi + reach - sweep)
    state[2] = math.hypot(_spread(e, rate, h) + 0.5 * curved * h * h, over)
    state[8], state[9] = across / sweep, faster / sweep
