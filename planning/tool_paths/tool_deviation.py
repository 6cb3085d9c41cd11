"""Deviation of the tool from its motion, for planners, bounded for every instant.

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
The proof bounds deviations by code of its own, ``planning.proof.tool.tool_deviation``.
Arrays of the chain go side by side: in a tuple, whose references count, it took 1.03 times as long.
"""

import math

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array
from kinematics.forward import frames_kernel
from kinematics.model.chain import Chain, JointType
from kinematics.trajectory.polynomial import shift_kernel
from planning.tool_motions.tool_corner import ToolCurve
from planning.tool_motions.tool_motion import (
    ALONG,
    ARC,
    AXIS,
    CENTER,
    KIND,
    LENGTH,
    LINE,
    NORMAL,
    ROTATION,
    SIDE,
    START,
    SWEEP,
    TURN,
)
from planning.tool_motions.tool_path import ToolRun
from planning.tool_paths.corner_deviation import (
    CELL_SIZE,
    Cell,
    angle_between,
    corner_kernel,
    farthest,
    nominal_kernel,
    norm,
)

_REVOLUTE = float(JointType.REVOLUTE)


def pieces_within(
    chain: Chain,
    run: ToolRun,
    places: Array,
    breaks: Array,
    coefficients: Array,
    tolerances: tuple[float, float],
) -> NDArray[np.bool_]:
    """Whether the tool is proved to keep to a run on each piece of a piecewise polynomial.

    Args:
        chain: The robot; its tip is the tool.
        run: The motions.
        places: Places of the run at the ends of the pieces, those where its motions meet among
            them, shape (m + 1,).
        breaks: Ends of the pieces in their own parameter, shape (m + 1,).
        coefficients: Shape (m, n, k), ascending.
        tolerances: Deviations allowed [m], [rad]; infinite where it is free.

    Returns:
        Shape (m,).
    """
    within = np.zeros(len(breaks) - 1, dtype=np.bool_)
    # Places of pieces and motions that differ by less are the same.
    same_place = 1e-12
    for part in run.parts:
        first = int(np.searchsorted(places, part.begin - same_place))
        last = int(np.searchsorted(places[:-1], part.end - same_place))
        if first < last:
            _, within[first:last], _ = piece_deviations(
                chain,
                breaks[first : last + 1],
                coefficients[first:last],
                part.motion,
                tolerances,
            )
    return within


def piece_deviations(
    chain: Chain,
    breaks: Array,
    coefficients: Array,
    motion: ToolCurve,
    tolerances: tuple[float, float],
) -> tuple[Array, NDArray[np.bool_], Array]:
    """Bounds of the deviation of every piece of a piecewise polynomial from a tool's motion.

    Args:
        chain: The robot; its tip is the tool.
        breaks: Shape (m + 1,), of time or any other parameter.
        coefficients: Shape (m, n, k), ascending.
        motion: Motion that the tool is to follow.
        tolerances: Deviations allowed [m], [rad]; infinite where it is free.

    Returns:
        Bounds of position [m] and orientation [rad], shape (m, 2), of a piece that goes too far
        what was found; whether each piece is proved, (m,); where each is farthest off, (m,).
    """
    tip, m = chain.tip, len(breaks) - 1
    bounds, fine, where = np.zeros((m, 2)), np.zeros(m), np.zeros(m)
    deviation_kernel(
        chain.model, tip.T_joint_link, tip.joint,
        np.ascontiguousarray(breaks), np.ascontiguousarray(coefficients), motion.numbers,
        np.array(tolerances), bounds, fine, where,
    )  # fmt: skip
    return bounds, fine != 0.0, where


@kernel(allocates=False)
def _twist_angle(m: Array, R: Array) -> float:
    """Angle about the axis a that R R_0^T contains, in (-pi, pi]."""
    # Of D = R R_0^T: sine from its skew part along a, cosine from what it does across a.
    trace, x, y, z = 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        trace += (
            R[0, k] * m[ROTATION + k]
            + R[1, k] * m[ROTATION + 3 + k]
            + R[2, k] * m[ROTATION + 6 + k]
        )
        x += R[2, k] * m[ROTATION + 3 + k] - R[1, k] * m[ROTATION + 6 + k]
        y += R[0, k] * m[ROTATION + 6 + k] - R[2, k] * m[ROTATION + k]
        z += R[1, k] * m[ROTATION + k] - R[0, k] * m[ROTATION + 3 + k]
    sine = 0.5 * (x * m[AXIS] + y * m[AXIS + 1] + z * m[AXIS + 2])
    return math.atan2(sine, 0.5 * (trace - 1.0))


@kernel
def deviation_kernel(
    model: Array, T_joint_tip: Array, last: int, breaks: Array,
    coefficients: Array, m: Array, tolerances: Array, bounds: Array, fine: Array, where: Array,
) -> None:  # fmt: skip
    """Kernel of ``piece_deviations``; ``fine`` is 1 where a piece is proved."""
    count, n, size = coefficients.shape
    c = np.empty((n, size))
    state = np.zeros(CELL_SIZE)
    work = np.empty((8, max(n, 4)))
    frames = np.empty((n, 4, 4))
    # Halvings of a piece; a cell of a millionth of a second has told all there is.
    max_depth = 40
    stack = np.empty((max_depth + 2, 3))
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
            cell_kernel(model, T_joint_tip, last, c, h, m, frames, work, state)
            now_p, now_r, upper_p, upper_r = (
                state[Cell.POSITION],
                state[Cell.ORIENTATION],
                state[Cell.POSITION_BOUND],
                state[Cell.ORIENTATION_BOUND],
            )
            if now_p > tolerances[0] or now_r > tolerances[1]:
                fine[piece] = 0.0
                worst_p, worst_r = max(worst_p, now_p), max(worst_r, now_r)
                where[piece] = breaks[piece] + at
                break
            # A bound is sharp that is at most a quarter above what was found, or below a tenth of
            # what is allowed.
            enough_p = max(0.1 * tolerances[0], 1.25 * max(now_p, worst_p))
            enough_r = max(0.1 * tolerances[1], 1.25 * max(now_r, worst_r))
            sharp = upper_p <= enough_p and upper_r <= enough_r
            allowed = upper_p <= tolerances[0] and upper_r <= tolerances[1]
            if sharp and allowed:
                worst_p, worst_r = max(worst_p, upper_p), max(worst_r, upper_r)
                share = max(upper_p / tolerances[0], upper_r / tolerances[1])
                if share > highest:
                    highest, where[piece] = share, breaks[piece] + at
                continue
            if depth >= max_depth:
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
    model: Array, T_joint_tip: Array, last: int, c: Array, h: float, m: Array,
    frames: Array, work: Array, state: Array,
) -> None:  # fmt: skip
    """Write the deviations in the middle of a cell and bounds over it into ``state`` (10,).

    ``c`` (n, k) holds the coefficients about the middle.
    """
    R, N = np.empty((3, 3)), np.empty((3, 3))
    tip_motion_kernel(model, T_joint_tip, last, c, h, frames, work, R, state)
    w = work[5]
    if m[KIND] == LINE:
        _line_kernel(m, h, work, R, state)
    elif m[KIND] == ARC:
        _arc_kernel(m, h, work, state)
    else:
        corner_kernel(m, h, work, R, state)
        return
    s, pace, bend = state[Cell.PLACE], state[Cell.PACE], state[Cell.PACE_CHANGE]
    nominal_kernel(m, s, N)
    state[Cell.ORIENTATION] = angle_between(N, R)
    state[Cell.ORIENTATION_BOUND] = np.inf
    if state[Cell.POSITION_BOUND] < np.inf:
        relative = norm(
            w[0] - m[TURN] * pace * m[AXIS],
            w[1] - m[TURN] * pace * m[AXIS + 1],
            w[2] - m[TURN] * pace * m[AXIS + 2],
        )
        state[Cell.ORIENTATION_BOUND] = (
            state[Cell.ORIENTATION]
            + relative * h
            + 0.5 * (state[Cell.ANGULAR] + m[TURN] * bend) * h * h
        )
        if m[KIND] == LINE and m[LENGTH] == 0.0:
            reach = abs(pace) * h
            state[Cell.ORIENTATION_BOUND] += max(0.0, reach - s, s + reach - 1.0) * m[TURN]
            state[Cell.ORIENTATION] += max(0.0, -s, s - 1.0) * m[TURN]


@kernel(allocates=False)
def tip_motion_kernel(
    model: Array, T_joint_tip: Array, last: int, c: Array, h: float,
    frames: Array, work: Array, R: Array, state: Array,
) -> None:  # fmt: skip
    """Write the tip's position ``work[3]``, velocities ``work[4]``, ``work[5]`` and rotation R.

    Bounds of its accelerations over the cell go to ``state``.
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
    frames_kernel(model, q[:n], frames)
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
    # ``Chain.model``: the row of the first joint, and the column of a joint's type.
    first_joint = 1
    kind_column = 0
    for j in range(last, -1, -1):
        F = frames[j]
        zx, zy, zz = F[0, 2], F[1, 2], F[2, 2]
        speed = c[j, 1] if size > 1 else 0.0
        before = 0.0
        for i in range(j):
            if model[first_joint + i, kind_column] == _REVOLUTE:
                before += V[i]
        if model[first_joint + j, kind_column] != _REVOLUTE:
            second += A[j] + 2.0 * V[j] * before
            moved += V[j] * h
            v[0] += speed * zx
            v[1] += speed * zy
            v[2] += speed * zz
            continue
        dx, dy, dz = p[0] - F[0, 3], p[1] - F[1, 3], p[2] - F[2, 3]
        cx, cy, cz = zy * dz - zz * dy, zz * dx - zx * dz, zx * dy - zy * dx
        lever = norm(cx, cy, cz) + moved
        v[0] += speed * cx
        v[1] += speed * cy
        v[2] += speed * cz
        w[0] += speed * zx
        w[1] += speed * zy
        w[2] += speed * zz
        second += lever * (A[j] + V[j] * V[j] + 2.0 * V[j] * before)
        turning += A[j] + V[j] * before
        moved += lever * V[j] * h
    state[Cell.ACCELERATION], state[Cell.ANGULAR] = second, turning


@kernel(allocates=False)
def _line_kernel(m: Array, h: float, work: Array, R: Array, state: Array) -> None:
    """Position deviation from a line for ``cell_kernel``."""
    p, v, w, e, rate = work[3], work[4], work[5], work[6], work[7]
    second, length = state[Cell.ACCELERATION], m[LENGTH]
    x, along = 0.0, 0.0
    for k in range(3):
        x += m[ALONG + k] * (p[k] - m[START + k])
        along += m[ALONG + k] * v[k]
    for k in range(3):
        e[k] = p[k] - m[START + k] - x * m[ALONG + k]
        rate[k] = v[k] - along * m[ALONG + k]
    state[Cell.POSITION] = norm(e[0], e[1], e[2])
    state[Cell.POSITION_BOUND] = farthest(e, rate, h) + 0.5 * second * h * h
    if length > 0.0:
        reach = abs(along) * h + 0.5 * second * h * h
        state[Cell.POSITION] = math.hypot(state[Cell.POSITION], max(0.0, -x, x - length))
        state[Cell.POSITION_BOUND] = math.hypot(
            state[Cell.POSITION_BOUND], max(0.0, reach - x, x + reach - length)
        )
        state[Cell.PLACE], state[Cell.PACE], state[Cell.PACE_CHANGE] = (
            x / length,
            along / length,
            second / length,
        )
        return
    # A turn on the spot: the place that fits best, at the pace that does.
    state[Cell.PLACE], state[Cell.PACE], state[Cell.PACE_CHANGE] = 0.0, 0.0, 0.0
    if m[TURN] > 0.0:
        turned = _twist_angle(m, R)
        turned += 2.0 * math.pi * math.floor((state[Cell.ANGLE] - turned) / (2.0 * math.pi) + 0.5)
        state[Cell.ANGLE] = turned
        state[Cell.PLACE] = turned / m[TURN]
        state[Cell.PACE] = (m[AXIS] * w[0] + m[AXIS + 1] * w[1] + m[AXIS + 2] * w[2]) / m[TURN]


@kernel(allocates=False)
def _arc_kernel(m: Array, h: float, work: Array, state: Array) -> None:
    """Position deviation from an arc for ``cell_kernel``."""
    p, v, e, rate = work[3], work[4], work[6], work[7]
    second, radius, sweep = state[Cell.ACCELERATION], m[LENGTH], m[SWEEP]
    a, b, z, va, vb, vz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        r = p[k] - m[CENTER + k]
        a += m[ALONG + k] * r
        b += m[SIDE + k] * r
        z += m[NORMAL + k] * r
        va += m[ALONG + k] * v[k]
        vb += m[SIDE + k] * v[k]
        vz += m[NORMAL + k] * v[k]
    distance = math.sqrt(a * a + b * b)
    phi = math.atan2(b, a)
    phi += 2.0 * math.pi * math.floor((state[Cell.ANGLE] - phi) / (2.0 * math.pi) + 0.5)
    state[Cell.ANGLE] = phi
    state[Cell.POSITION] = math.hypot(distance - radius, z)
    state[Cell.POSITION] = math.hypot(state[Cell.POSITION], radius * max(0.0, -phi, phi - sweep))
    state[Cell.POSITION_BOUND], state[Cell.PLACE], state[Cell.PACE], state[Cell.PACE_CHANGE] = (
        np.inf,
        phi / sweep,
        0.0,
        0.0,
    )
    fastest = norm(v[0], v[1], v[2]) + second * h
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
    state[Cell.POSITION_BOUND] = math.hypot(farthest(e, rate, h) + 0.5 * curved * h * h, over)
    state[Cell.PACE], state[Cell.PACE_CHANGE] = across / sweep, faster / sweep
