"""The numeric method for batches: eight poses at a time, one in each SIMD lane.

Each lane searches for one pose as ``levenberg_marquardt.search_kernel`` does, with the same
arithmetic, so that answers are the same to the last bit; a lane that is through takes the next pose
of the batch. Only the beginnings of starts, once in many steps, are made for each lane alone.

Damped steps of the numeric method for eight poses at a time, one in each SIMD lane.
"""

from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from compiled.random import State
from compiled.simd import LANES, Conditions, anywhere, bits, choose, fill, load, on_stack, store
from compiled.simd_transpose import store_rows_kernel
from compiled.sincos import turns_kernel
from kinematics.arrays import Array, Indices
from kinematics.frame import Frame, frame_kernel
from kinematics.ik.numeric.dls_step import (
    Error,
    add_outer_kernel,
    diagonal_kernel,
    error_kernel,
    factor_solve_kernel,
    project_kernel,
)
from kinematics.ik.numeric.levenberg_marquardt import (
    DAMPING,
    GAIN,
    LEAST_DAMPING,
    LEAST_MU,
    LESS,
    LONG,
    LONG_GAIN,
    LONG_PATIENCE,
    MORE,
    NEAR_SIZE,
    PATIENCE,
    STEPS,
    SearchSettings,
    SearchSpace,
    draw_kernel,
    pick_kernel,
    search_kernel,
    weigh_column_kernel,
    weigh_kernel,
)
from kinematics.simd_frames import (
    COLUMN,
    COLUMN_SIZE,
    FRAME_SIZE,
    axes_lanes_kernel,
    column_lanes_kernel,
    load_column_kernel,
    load_frame_kernel,
)

# Rows of vectors that the search keeps of its lanes, by the index of their first number.
#: Squared error.
SQUARE = 0
#: Distance from the target [m].
POSITION = LANES
#: Angle from the target [rad].
ROTATION = 2 * LANES
#: The least square of all starts.
LEAST = 3 * LANES
#: The square that progress is counted from.
MARK = 4 * LANES
#: The damping factor mu.
MU = 5 * LANES
#: Steps of all starts.
ALL_STEPS = 6 * LANES
#: Steps of this start.
START_STEPS = 7 * LANES
#: Steps without progress.
STALE = 8 * LANES
#: 1 where a start begins.
FRESH = 9 * LANES
#: 1 where a lane has a pose.
ACTIVE = 10 * LANES
#: Steps without progress after which the start is given up.
LANE_PATIENCE = 11 * LANES
#: Share of the square that counts as progress.
LANE_GAIN = 12 * LANES
#: Numbers in all.
STATE_SIZE = 13 * LANES


class LaneSearch(NamedTuple):
    """Arrays of the eight searches; numbers of the lanes lie side by side.

    Args:
        J: Weighed Jacobians, columns one after the other, shape (n * COLUMN_SIZE,).
        e: Weighed errors, shape (COLUMN_SIZE,).
        q: Configurations, shape (8 n,).
        trial: Configurations that are tried, shape (8 n,).
        state: Rows named above, shape (STATE_SIZE,).
    """

    J: Array
    e: Array
    q: Array
    trial: Array
    state: Array


@kernel(allocates=False)
def propose_kernel(bounds: Array, search: LaneSearch, start: Array, mask: Array) -> None:
    """Write the step of every lane, as ``dls_step.step_within_kernel`` has it, or its start.

    Args:
        bounds: Limits of the joints, see ``SearchSpace``.
        search: The searches; the steps go into ``trial``.
        start: Configurations that new starts begin at, shape (8 n,).
        mask: Work array: 1 for each joint that is free to move, shape (8 n,).
    """
    J, q, state = search.J, search.q, search.state
    lower, upper = bounds[0], bounds[1]
    n = lower.shape[0]
    error = load_column_kernel(search.e, 0)
    fresh = load(state, FRESH) > 0.0
    damping = load(state, MU) * load(state, SQUARE) + LEAST_DAMPING
    A = diagonal_kernel(damping, fill(0.0))
    for j in range(n):
        column, value = load_column_kernel(J, COLUMN_SIZE * j), load(q, LANES * j)
        low, high, moves = value <= lower[j], value >= upper[j], fill(1.0)
        if anywhere(low | high):
            pull = project_kernel(column, error)
            moves = choose((low & (pull <= 0.0)) | (high & (pull >= 0.0)), 0.0, moves)
            c0, c1, c2, c3, c4, c5 = column
            column = moves * c0, moves * c1, moves * c2, moves * c3, moves * c4, moves * c5
        store(mask, LANES * j, moves)
        A = add_outer_kernel(A, column)
    x = factor_solve_kernel(A, error)
    for j in range(n):
        at = LANES * j
        step, value = project_kernel(load_column_kernel(J, COLUMN_SIZE * j), x), load(q, at)
        moved = min(max(value + step, lower[j]), upper[j])
        moved = choose(load(mask, at) > 0.0, moved, value)
        store(search.trial, at, choose(fresh, load(start, at), moved))


@kernel(allocates=False)
def judge_kernel(
    space: SearchSpace, settings: SearchSettings, last: int, B: Frame, targets: Array,
    joint_axes: Array, search: LaneSearch,
) -> int:  # fmt: skip
    """Keep the trials that are better; the lanes whose start is over, as bits.

    Args:
        space: The chain.
        settings: Settings of the search.
        last: The last joint that moves the link.
        B: Frames of the link at the trials.
        targets: Frames that it is to reach, shape (FRAME_SIZE,).
        joint_axes: Axes of the joints at the trials, see ``simd_frames.axes_lanes_kernel``.
        search: The searches.
    """
    w, axes, T = space.weight, settings.axes, load_frame_kernel(targets, 0)
    J, e, q, trial, state = search.J, search.e, search.q, search.trial, search.state
    weighed, after, position, rotation = weigh_kernel(error_kernel(B, T), T, axes, w)
    fresh, square = load(state, FRESH) > 0.0, load(state, SQUARE)
    gains = after < square
    accepted = gains | fresh
    square = choose(accepted, after, square)
    position = choose(accepted, position, load(state, POSITION))
    rotation = choose(accepted, rotation, load(state, ROTATION))
    store_rows_kernel(e, 0, LANES, _accept_lanes(accepted, weighed, load_column_kernel(e, 0)))
    for j in range(trial.shape[0] // LANES):
        at = COLUMN_SIZE * j
        column = column_lanes_kernel(space.model, joint_axes, j, last, B)
        column = weigh_column_kernel(column, T, axes, w)
        store_rows_kernel(J, at, LANES, _accept_lanes(accepted, column, load_column_kernel(J, at)))
        store(q, LANES * j, choose(accepted, load(trial, LANES * j), load(q, LANES * j)))
    mu = load(state, MU)
    mu = choose(fresh, DAMPING, choose(gains, max(LESS * mu, LEAST_MU), MORE * mu))
    one = choose(fresh, 0.0, 1.0)
    started = choose(fresh, 0.0, load(state, START_STEPS) + 1.0)
    mark = load(state, MARK)
    again = fresh | (square < load(state, LANE_GAIN) * mark)
    stale = choose(again, 0.0, load(state, STALE) + 1.0)
    store(state, SQUARE, square)
    store(state, POSITION, position)
    store(state, ROTATION, rotation)
    store(state, MU, mu)
    store(state, MARK, choose(again, square, mark))
    store(state, STALE, stale)
    store(state, ALL_STEPS, load(state, ALL_STEPS) + one)
    store(state, START_STEPS, started)
    store(state, FRESH, 0.0)
    done = (position <= settings.position_tolerance) & (rotation <= settings.orientation_tolerance)
    over = done | (stale > load(state, LANE_PATIENCE)) | (started >= STEPS)
    return bits(over & (load(state, ACTIVE) > 0.0))


@kernel(inline="code")
def _accept_lanes(accepted: Conditions, new: Error, old: Error) -> Error:
    """The new vectors in the lanes where they are accepted, else the old ones."""
    return (
        choose(accepted, new[0], old[0]), choose(accepted, new[1], old[1]),
        choose(accepted, new[2], old[2]), choose(accepted, new[3], old[3]),
        choose(accepted, new[4], old[4]), choose(accepted, new[5], old[5]),
    )  # fmt: skip


class _LaneStarts(NamedTuple):
    """Poses and starts of the searches in the lanes.

    Args:
        T: Targets, shape (FRAME_SIZE,).
        start: Configurations that new starts begin at, shape (8 n,).
        state: State as of ``LaneSearch``.
        draws: States of the random draws, shape (8, 1).
    """

    T: Array
    start: Array
    state: Array
    draws: State


@kernel
def numeric_simd_kernel(
    space: SearchSpace, settings: SearchSettings, targets: Array, begin: Array, best: Array,
    solved: Indices,
) -> None:  # fmt: skip
    """``levenberg_marquardt.search_kernel`` for targets (m, 4, 4) from begin (m, n).

    Args:
        space: The chain up to the link.
        settings: Settings of the search.
        targets: T_base_link, shape (m, 4, 4).
        begin: Configurations to begin at, shape (m, n).
        best: The nearest configurations, their errors, and the steps and starts spent, shape
            (m, n + 4).
        solved: 1 where the tolerances are met, else 0, shape (m,).
    """
    m, n = begin.shape
    model, link, axes, bounds = space.model, space.link, settings.axes, space.bounds
    size, last = LANES * n, int(model[1 + n + link, 0])
    J, joint_axes, e, T = (
        np.zeros(COLUMN * size),
        np.zeros(COLUMN * size),
        np.zeros(COLUMN_SIZE),
        np.zeros(FRAME_SIZE),
    )
    q, trial, start, state = np.zeros(size), np.zeros(size), np.zeros(size), np.zeros(STATE_SIZE)
    cosines, sines, mask = np.zeros(size), np.zeros(size), np.zeros(size)
    draws = np.zeros((LANES, 1), dtype=np.uint64)
    search, lanes = LaneSearch(J, e, q, trial, state), _LaneStarts(T, start, state, draws)
    near, own, draw = np.zeros(NEAR_SIZE), np.zeros(n), np.zeros(n)
    poses, attempts = np.zeros(LANES, dtype=np.int64), np.zeros(LANES, dtype=np.int64)
    following, active = 0, 0
    for lane in range(min(m, LANES)):
        _give_pose(lane, targets[lane], begin[lane], settings.seed, bounds, lanes)
        poses[lane], attempts[lane] = lane, 0
        following, active = following + 1, active + 1
    while active > 0:
        propose_kernel(bounds, search, start, mask)
        turns_kernel(trial, cosines, sines)
        B = axes_lanes_kernel(model, trial, cosines, sines, link, joint_axes)
        over = judge_kernel(space, settings, last, B, T, joint_axes, search)
        for lane in range(LANES if over != 0 else 0):
            if (over >> lane) & 1 == 0:
                continue
            k = poses[lane]
            position, rotation = state[POSITION + lane], state[ROTATION + lane]
            done = position <= settings.position_tolerance
            done = done and rotation <= settings.orientation_tolerance
            if state[SQUARE + lane] < state[LEAST + lane] or done:
                state[LEAST + lane] = state[SQUARE + lane]
                for j in range(n):
                    best[k, j] = q[LANES * j + lane]
                best[k, n], best[k, n + 1] = position, rotation
            attempts[lane] += 1
            attempt = attempts[lane]
            if done or attempt >= settings.starts:
                best[k, n + 2], best[k, n + 3] = state[ALL_STEPS + lane], attempt
                solved[k] = 1 if done else 0
                if following < m:
                    _give_pose(
                        lane, targets[following], begin[following], settings.seed, bounds, lanes
                    )
                    poses[lane], attempts[lane] = following, 0
                    following += 1
                else:
                    state[ACTIVE + lane] = 0.0
                    active -= 1
                continue
            target = frame_kernel(targets[k])
            for j in range(n):
                own[j] = q[LANES * j + lane]
            if attempt % LONG != LONG - 1:
                pick_kernel(space, target, axes, draws[lane], near, own)
            else:
                draw_kernel(space, target, axes, draws[lane], draw, own)
            _begin(lane, attempt, own, bounds, lanes)


@kernel(allocates=False)
def _give_pose(
    lane: int, target: Array, begin: Array, seed: int, bounds: Array, lanes: _LaneStarts
) -> None:
    """Give a lane a pose (4, 4) and the configuration (n,) that its first start begins at."""
    state, only = lanes.state, _only(lane)
    for i in range(12):
        _put(lanes.T, LANES * i, only, target[i // 4, i % 4])
    lanes.draws[lane, 0] = np.uint64(seed)
    state[LEAST + lane] = np.inf
    _put(state, ALL_STEPS, only, 0.0)
    _put(state, ACTIVE, only, 1.0)
    _begin(lane, 0, begin, bounds, lanes)


@kernel(allocates=False)
def _begin(lane: int, attempt: int, q: Array, bounds: Array, lanes: _LaneStarts) -> None:
    """Let a lane begin again at q (n,), taken into the limits."""
    only, long = _only(lane), attempt % LONG == LONG - 1
    _put(lanes.state, LANE_PATIENCE, only, LONG_PATIENCE if long else PATIENCE)
    _put(lanes.state, LANE_GAIN, only, LONG_GAIN if long else GAIN)
    _put(lanes.state, FRESH, only, 1.0)
    for j in range(q.shape[0]):
        _put(lanes.start, LANES * j, only, min(max(q[j], bounds[0, j]), bounds[1, j]))


@kernel(inline="code")
def _only(lane: int) -> Conditions:
    """Whether a lane is the one of that number."""
    numbers = on_stack(LANES)
    for k in range(LANES):
        numbers[k] = k
    return (load(numbers, 0) >= lane) & (load(numbers, 0) <= lane)


@kernel(inline="code")
def _put(array: Array, at: int, only: Conditions, value: float) -> None:
    """Write a number into one lane: reading a vector next waits less for a vector written."""
    store(array, at, choose(only, value, load(array, at)))


@kernel
def solve_batch_kernel(
    space: SearchSpace, settings: SearchSettings, targets: Array, begin: Array, best: Array,
    solved: Indices,
) -> None:  # fmt: skip
    """``numeric_simd_kernel``, or one pose after the other where they are few."""
    m, n = begin.shape
    if m >= LANES:
        numeric_simd_kernel(space, settings, targets, begin, best, solved)
        return
    for k in range(m):
        solved[k], position, rotation, steps, spent = search_kernel(
            space, settings, targets[k], 0, begin[k], best[k, :n]
        )
        best[k, n], best[k, n + 1] = position, rotation
        best[k, n + 2], best[k, n + 3] = steps, spent
