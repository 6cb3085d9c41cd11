"""The numeric method for batches: eight poses at a time, one in each SIMD lane.

Each lane searches for one pose as ``levenberg_marquardt.search_kernel`` does, with the same
arithmetic, so that answers are the same to the last bit; a lane that is through takes the next pose
of the batch. Only the beginnings of starts, once in many steps, are made for each lane alone.
"""

from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from compiled.random import State
from compiled.simd import LANES, Conditions, choose, load, on_stack, store
from compiled.sincos import turns_kernel
from kinematics.arrays import Array, Indices
from kinematics.frame import frame_kernel
from kinematics.ik.numeric.lane_steps import (
    ACTIVE,
    ALL_STEPS,
    FRESH,
    LANE_GAIN,
    LANE_PATIENCE,
    LEAST,
    POSITION,
    ROTATION,
    SQUARE,
    STATE_SIZE,
    LaneRoom,
    LaneSearch,
    judge_kernel,
    propose_kernel,
)
from kinematics.ik.numeric.levenberg_marquardt import (
    GAIN,
    LONG,
    LONG_GAIN,
    LONG_PATIENCE,
    NEAR_SIZE,
    PATIENCE,
    SearchSettings,
    SearchSpace,
    draw_kernel,
    pick_kernel,
    search_kernel,
)
from kinematics.simd_frames import COLUMN, COLUMN_SIZE, FRAME_SIZE, axes_lanes_kernel


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
    cosines, sines, draws = np.zeros(size), np.zeros(size), np.zeros((LANES, 1), dtype=np.uint64)
    search, lanes = LaneSearch(J, e, q, trial, state), _LaneStarts(T, start, state, draws)
    room = LaneRoom(np.zeros(size), np.zeros(n * size), np.zeros(size))
    near, own, draw = np.zeros(NEAR_SIZE), np.zeros(n), np.zeros(n)
    poses, attempts = np.zeros(LANES, dtype=np.int64), np.zeros(LANES, dtype=np.int64)
    following, active = 0, 0
    for lane in range(min(m, LANES)):
        _give_pose(lane, targets[lane], begin[lane], settings.seed, bounds, lanes)
        poses[lane], attempts[lane] = lane, 0
        following, active = following + 1, active + 1
    while active > 0:
        propose_kernel(bounds, search, start, room)
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
