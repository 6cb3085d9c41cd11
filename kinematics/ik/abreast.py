"""The numeric method for eight poses abreast, for batches.

Each lane (see ``lanes``) searches for one pose as ``search.solve_kernel`` does, operation by
operation, so that answers are the same to the last bit; a lane that is through takes the next pose
of the batch. Frames, Jacobians and the damped equations of all lanes compile to vector
instructions; what differs from lane to lane, whether to keep a step or where to begin again, is
decided for each alone.
"""

import numpy as np

from kinematics.chain import Array, Indices
from kinematics.ik.search import (
    DAMPING,
    GAIN,
    LEAST_DAMPING,
    LEAST_MU,
    LESS,
    LONG,
    LONG_GAIN,
    LONG_PATIENCE,
    MORE,
    PATIENCE,
    STEPS,
    draw_kernel,
    pick_kernel,
    solve_kernel,
    weigh_kernel,
)
from kinematics.ik.step import State, error_kernel, frame_kernel, step_within_kernel
from kinematics.kernel import kernel
from kinematics.lanes import LANES, jacobian_lanes_kernel
from kinematics.turns import turns_kernel

#: Columns of a lane's record: numbers, then counts.
_SQUARE, _POSITION, _ROTATION, _LEAST, _MARK, _MU = 0, 1, 2, 3, 4, 5
_POSE, _ATTEMPT, _ALL_STEPS, _START_STEPS, _STALE, _FRESH = 0, 1, 2, 3, 4, 5


@kernel
def equations_lanes_kernel(J: Array, mask: Array, damping: Array, n: int, A: Array) -> None:
    """Write the lower half of J J^T + damping I by rows, of free joints, into A (21 * LANES,)."""
    for i in range(168):
        A[i] = 0.0
    for lane in range(8):
        d = damping[lane]
        A[lane], A[16 + lane], A[40 + lane] = d, d, d
        A[72 + lane], A[112 + lane], A[160 + lane] = d, d, d
    for j in range(n):
        at = 48 * j
        for lane in range(8):
            m = mask[8 * j + lane]
            j0, j1, j2 = m * J[at + lane], m * J[at + 8 + lane], m * J[at + 16 + lane]
            j3, j4, j5 = m * J[at + 24 + lane], m * J[at + 32 + lane], m * J[at + 40 + lane]
            A[lane] += j0 * j0
            A[8 + lane] += j1 * j0
            A[16 + lane] += j1 * j1
            A[24 + lane] += j2 * j0
            A[32 + lane] += j2 * j1
            A[40 + lane] += j2 * j2
            A[48 + lane] += j3 * j0
            A[56 + lane] += j3 * j1
            A[64 + lane] += j3 * j2
            A[72 + lane] += j3 * j3
            A[80 + lane] += j4 * j0
            A[88 + lane] += j4 * j1
            A[96 + lane] += j4 * j2
            A[104 + lane] += j4 * j3
            A[112 + lane] += j4 * j4
            A[120 + lane] += j5 * j0
            A[128 + lane] += j5 * j1
            A[136 + lane] += j5 * j2
            A[144 + lane] += j5 * j3
            A[152 + lane] += j5 * j4
            A[160 + lane] += j5 * j5


@kernel
def dual_lanes_kernel(A: Array, e: Array, x: Array) -> None:
    """Solve A x = e, all by lanes, as ``step.dual_kernel`` does."""
    for i in range(8):
        a00, a10, a11, a20, a21, a22 = A[i], A[8 + i], A[16 + i], A[24 + i], A[32 + i], A[40 + i]
        a30, a31, a32, a33 = A[48 + i], A[56 + i], A[64 + i], A[72 + i]
        a40, a41, a42, a43, a44 = A[80 + i], A[88 + i], A[96 + i], A[104 + i], A[112 + i]
        a50, a51, a52, a53 = A[120 + i], A[128 + i], A[136 + i], A[144 + i]
        a54, a55 = A[152 + i], A[160 + i]
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
        x0 = e[i]
        x1 = e[8 + i] - l1 * x0
        x2 = e[16 + i] - l2 * x0 - m2 * x1
        x3 = e[24 + i] - l3 * x0 - m3 * x1 - n3 * x2
        x4 = e[32 + i] - l4 * x0 - m4 * x1 - n4 * x2 - o4 * x3
        x5 = (e[40 + i] - l5 * x0 - m5 * x1 - n5 * x2 - o5 * x3 - p5 * x4) * d5
        x4 = x4 * d4 - p5 * x5
        x3 = x3 * d3 - o4 * x4 - o5 * x5
        x2 = x2 * d2 - n3 * x3 - n4 * x4 - n5 * x5
        x1 = x1 * d1 - m2 * x2 - m3 * x3 - m4 * x4 - m5 * x5
        x[i] = x0 * d0 - l1 * x1 - l2 * x2 - l3 * x3 - l4 * x4 - l5 * x5
        x[8 + i], x[16 + i], x[24 + i], x[32 + i], x[40 + i] = x1, x2, x3, x4, x5


@kernel
def mask_lanes_kernel(
    J: Array, e: Array, q: Array, lower: Array, upper: Array, mask: Array, counts: Indices
) -> None:
    """Write which joints are free to move, as ``step.step_within_kernel`` has it, and how many."""
    for lane in range(8):
        counts[lane] = 0
    for j in range(lower.shape[0]):
        low, high, at = lower[j], upper[j], 48 * j
        for lane in range(8):
            value, free = q[8 * j + lane], 1.0
            if value <= low or value >= high:
                pull = (
                    J[at + lane] * e[lane] + J[at + 8 + lane] * e[8 + lane]
                    + J[at + 16 + lane] * e[16 + lane] + J[at + 24 + lane] * e[24 + lane]
                    + J[at + 32 + lane] * e[32 + lane] + J[at + 40 + lane] * e[40 + lane]
                )  # fmt: skip
                if (value <= low and pull <= 0.0) or (value >= high and pull >= 0.0):
                    free = 0.0
            mask[8 * j + lane] = free
            counts[lane] += int(free)


@kernel
def step_lanes_kernel(
    J: Array, x: Array, q: Array, mask: Array, lower: Array, upper: Array, trial: Array
) -> None:
    """Write q + J^T x of the free joints, clipped to the limits, into ``trial`` (n * LANES,)."""
    for j in range(lower.shape[0]):
        low, high, at = lower[j], upper[j], 48 * j
        for lane in range(8):
            step = (
                J[at + lane] * x[lane] + J[at + 8 + lane] * x[8 + lane]
                + J[at + 16 + lane] * x[16 + lane] + J[at + 24 + lane] * x[24 + lane]
                + J[at + 32 + lane] * x[32 + lane] + J[at + 40 + lane] * x[40 + lane]
            )  # fmt: skip
            moved = q[8 * j + lane] + mask[8 * j + lane] * step
            trial[8 * j + lane] = min(max(moved, low), high)


@kernel
def keep_kernel(kept: Array, fresh: Array, old: Array) -> None:
    """Overwrite rows of lanes by those of ``fresh`` where ``kept`` (LANES,) is not 0."""
    for row in range(old.shape[0] // 8):
        for lane in range(8):
            i = 8 * row + lane
            old[i] = fresh[i] if kept[lane] != 0.0 else old[i]


@kernel
def alone_kernel(
    J: Array, e: Array, q: Array, bounds: Array, damping: float, lane: int, room: Array,
    free: Indices, trial: Array,
) -> None:  # fmt: skip
    """``step.step_within_kernel`` for one lane, with fewer than six joints free."""
    n = bounds.shape[1]
    own, room = room[: 6 * n].reshape((6, n)), room[6 * n :]
    H, room = room[: n * n].reshape((n, n)), room[n * n :]
    error, g, start, out = room[:6], room[6 : 12 + n], room[12 + n : 12 + 2 * n], room[12 + 2 * n :]
    for j in range(n):
        start[j] = q[8 * j + lane]
        for k in range(6):
            own[k, j] = J[48 * j + 8 * k + lane]
    for k in range(6):
        error[k] = e[8 * k + lane]
    step_within_kernel(own, error, start, bounds[0], bounds[1], damping, free, H, g, out)
    for j in range(n):
        trial[8 * j + lane] = out[j]


@kernel
def abreast_kernel(
    model: Array, link: int, targets: Array, axes: Array, bounds: Array, table: Array,
    scales: tuple[float, float, float], starts: int, seed: int, begin: Array, best: Array,
    solved: Indices,
) -> None:  # fmt: skip
    """``search.solve_kernel`` for targets (m, 4, 4) from begin (m, n), all axes counting, n > 5."""
    m, n = begin.shape
    if link < 0:
        link = int(model[0, 1])
    size, last, w = 8 * n, int(model[1 + n + link, 0]), scales[2]
    lower, upper = bounds[0], bounds[1]
    J, J_trial, A, B = np.zeros(6 * size), np.zeros(6 * size), np.zeros(168), np.zeros(96)
    q, trial, mask = np.zeros(size), np.zeros(size), np.zeros(size)
    cosines, sines = np.zeros(size), np.zeros(size)
    e, x, damping, kept = np.zeros(48), np.zeros(48), np.zeros(8), np.zeros(8)
    e_trial, start, room = np.zeros(6), np.zeros((8, n)), np.zeros(9 * n + n * n + 12 + 12)
    near, spare = np.zeros(min(64, table.shape[1])), np.zeros((6, n))
    own, free, counts = np.zeros(n), np.zeros(n, dtype=np.int64), np.zeros(8, dtype=np.int64)
    real, whole = np.zeros((8, 6)), np.zeros((8, 6), dtype=np.int64)
    states = np.zeros((8, 1), dtype=np.uint64)
    following, active = 0, 0
    for lane in range(8):
        whole[lane, _POSE] = -1
        if following < m:
            _take(lane, following, seed, begin, lower, upper, start, real, whole, states)
            following, active = following + 1, active + 1
    while active > 0:
        mask_lanes_kernel(J, e, q, lower, upper, mask, counts)
        for lane in range(8):
            damping[lane] = real[lane, _MU] * real[lane, _SQUARE] + LEAST_DAMPING
        equations_lanes_kernel(J, mask, damping, n, A)
        dual_lanes_kernel(A, e, x)
        step_lanes_kernel(J, x, q, mask, lower, upper, trial)
        for lane in range(8):
            if whole[lane, _FRESH] != 0:
                for j in range(n):
                    trial[8 * j + lane] = start[lane, j]
            elif counts[lane] < 6 and whole[lane, _POSE] >= 0:
                alone_kernel(J, e, q, bounds, damping[lane], lane, room, free, trial)
        turns_kernel(trial, cosines, sines)
        jacobian_lanes_kernel(model, trial, cosines, sines, link, B, J_trial)
        for j in range(n):
            for i in range(48 * j + 24, 48 * j + 48):
                J_trial[i] = w * J_trial[i]
        for lane in range(8):
            kept[lane] = 0.0
            k = whole[lane, _POSE]
            if k < 0:
                continue
            T = frame_kernel(targets[k])
            frame = (
                B[lane], B[8 + lane], B[16 + lane], B[24 + lane], B[32 + lane], B[40 + lane],
                B[48 + lane], B[56 + lane], B[64 + lane], B[72 + lane], B[80 + lane], B[88 + lane],
            )  # fmt: skip
            after, position, rotation = weigh_kernel(error_kernel(frame, T), T, axes, w, e_trial)
            if _judged(after, lane, real, whole):
                kept[lane] = 1.0
                real[lane, _SQUARE] = after
                real[lane, _POSITION], real[lane, _ROTATION] = position, rotation
                for i in range(6):
                    e[8 * i + lane] = e_trial[i]
        keep_kernel(kept, J_trial, J)
        keep_kernel(kept, trial, q)
        for lane in range(8):
            k = whole[lane, _POSE]
            if k < 0:
                continue
            done = real[lane, _POSITION] <= scales[0] and real[lane, _ROTATION] <= scales[1]
            if not done and not _given_up(lane, whole):
                continue
            if real[lane, _SQUARE] < real[lane, _LEAST] or done:
                real[lane, _LEAST] = real[lane, _SQUARE]
                for j in range(n):
                    best[k, j] = q[8 * j + lane]
                best[k, n], best[k, n + 1] = real[lane, _POSITION], real[lane, _ROTATION]
            whole[lane, _ATTEMPT] += 1
            attempt = whole[lane, _ATTEMPT]
            if done or attempt >= starts:
                best[k, n + 2], best[k, n + 3] = whole[lane, _ALL_STEPS], attempt
                solved[k] = 1 if done else 0
                whole[lane, _POSE], whole[lane, _FRESH] = -1, 0
                if following < m:
                    _take(lane, following, seed, begin, lower, upper, start, real, whole, states)
                    following += 1
                else:
                    active -= 1
                continue
            T = frame_kernel(targets[k])
            for j in range(n):
                own[j] = q[8 * j + lane]
            if attempt % LONG != LONG - 1:
                pick_kernel(table, T, axes, w, states[lane], last, e_trial, near, own)
            else:
                draw_kernel(
                    model, link, T, axes, bounds[2], bounds[3], w, states[lane], room[:n],
                    e_trial, spare, own,
                )  # fmt: skip
            for j in range(n):
                start[lane, j] = own[j]
            whole[lane, _FRESH] = 1


@kernel
def _take(
    lane: int, pose: int, seed: int, begin: Array, lower: Array, upper: Array, start: Array,
    real: Array, whole: Indices, states: State,
) -> None:  # fmt: skip
    """Give a lane a pose."""
    for j in range(begin.shape[1]):
        start[lane, j] = min(max(begin[pose, j], lower[j]), upper[j])
    states[lane, 0] = np.uint64(seed)
    real[lane, _LEAST] = np.inf
    whole[lane, _POSE], whole[lane, _ATTEMPT] = pose, 0
    whole[lane, _ALL_STEPS], whole[lane, _FRESH] = 0, 1


@kernel
def _judged(after: float, lane: int, real: Array, whole: Indices) -> bool:
    """Count a step; whether to keep what it led to."""
    if whole[lane, _FRESH] != 0:
        whole[lane, _FRESH], whole[lane, _START_STEPS], whole[lane, _STALE] = 0, 0, 0
        real[lane, _MU], real[lane, _MARK] = DAMPING, after
        return True
    whole[lane, _ALL_STEPS] += 1
    whole[lane, _START_STEPS] += 1
    better = after < real[lane, _SQUARE]
    real[lane, _MU] = max(LESS * real[lane, _MU], LEAST_MU) if better else MORE * real[lane, _MU]
    gain = LONG_GAIN if whole[lane, _ATTEMPT] % LONG == LONG - 1 else GAIN
    square = after if better else real[lane, _SQUARE]
    whole[lane, _STALE] += 1
    if square < gain * real[lane, _MARK]:
        real[lane, _MARK], whole[lane, _STALE] = square, 0
    return bool(better)


@kernel
def _given_up(lane: int, whole: Indices) -> bool:
    """Whether a start has got its steps, or gains too little."""
    patience = LONG_PATIENCE if whole[lane, _ATTEMPT] % LONG == LONG - 1 else PATIENCE
    return bool(whole[lane, _STALE] > patience or whole[lane, _START_STEPS] >= STEPS)


@kernel
def solve_batch_kernel(
    model: Array, link: int, targets: Array, axes: Array, bounds: Array, table: Array,
    scales: tuple[float, float, float], starts: int, seed: int, begin: Array, best: Array,
    solved: Indices,
) -> None:  # fmt: skip
    """``solve_kernel`` for targets (m, 4, 4) from begin (m, n), the draws the same for each."""
    m, n = begin.shape
    if m >= LANES and n >= 6 and axes[6] == 0.0:
        abreast_kernel(
            model, link, targets, axes, bounds, table, scales, starts, seed, begin, best, solved
        )
        return
    for k in range(m):
        solved[k] = solve_kernel(
            model, link, targets[k], axes, bounds, table, scales, starts, 0, seed, begin[k], best[k]
        )
