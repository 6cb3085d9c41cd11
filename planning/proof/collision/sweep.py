"""Sweep along a trajectory that proves all pairs apart on every interval of time, earliest first.

Intervals whose pairs are not all settled (``interval_check``) are halved; a pair whose interval is
so short that halving can't help is left to a referee.
"""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from compiled.kernel import direct, directly, kernel
from kinematics.arrays import Array, Indices
from kinematics.trajectory.trajectory import Trajectory
from planning.proof.collision.interval_check import check_interval
from planning.proof.collision.pair_table import PairArrays, any_pairs
from planning.proof.collision.sweep_state import (
    OPEN,
    PROBE,
    REFERRED,
    SHARP,
    TOP,
    VISITS,
    Sweep,
    moves_far,
    pass_on,
    pop_interval,
    push_halves,
    start_kernel,
)

# Why a sweep stops.
#: All pairs are settled on all intervals.
DONE = 0
#: The referee has to decide about pairs of the last interval.
ASKING = 1
#: It has looked at as many intervals as it may at once.
PAUSED = 2
#: There is no room for the pairs that are open: the interval has to be looked at again.
FULL = 3


class Proved(NamedTuple):
    """Fields of a sweep that tell what it has proved.

    Args:
        counters: Counters as in ``Sweep``.
        clearance: Clearance as in ``Sweep``.
        closest: Closest pair as in ``Sweep``.
        nearest: Nearest pair as in ``Sweep``.
    """

    counters: Indices
    clearance: Array
    closest: Indices
    nearest: Array


def sweep_from_start(
    trajectory: Trajectory, model: PairArrays, most: int, *, sharp: bool
) -> tuple[int, Proved, Sweep | None]:
    """Sweep a trajectory from its start: why it stopped, what it proved, and itself if not DONE.

    Args:
        trajectory: The motion.
        model: The pairs.
        most: Intervals to look at.
        sharp: Sharpness as in ``run``.
    """
    return _run_first()(model, trajectory.breaks, trajectory.coefficients, sharp, most)


def sweep_on(
    trajectory: Trajectory, model: PairArrays, sweep: Sweep, most: int, *, sharp: bool
) -> int:
    """Sweep on: ``run`` without the look at its arguments' types, which are many.

    Args:
        trajectory: The motion.
        model: The pairs.
        sweep: The sweep.
        most: Intervals to look at.
        sharp: Sharpness as in ``run``.
    """
    motion = trajectory.breaks, trajectory.coefficients
    return directly(run, model, *motion, sweep, sharp, most)


@cache
def _run_first() -> Callable[
    [PairArrays, Array, Array, bool, int], tuple[int, Proved, Sweep | None]
]:
    return direct(run_first, any_pairs(), np.zeros(2), np.zeros((1, 1, 1)), True, 1)


@kernel
def run_first(
    model: PairArrays, breaks: Array, coefficients: Array, sharp: bool, most: int
) -> tuple[int, Proved, Sweep | None]:
    """``sweep_from_start``: a sweep that is done is not handed to Python array by array."""
    sizes = model.bodies.shape[1], model.joints.shape[0], model.moving
    w = start_kernel(breaks, coefficients, model.roots, sizes)
    state = run(model, breaks, coefficients, w, sharp, most)
    proved = Proved(w.counters, w.clearance, w.closest, w.nearest)
    if state == DONE:
        return state, proved, None
    return state, proved, w


@kernel(allocates=False)
def run(
    model: PairArrays, breaks: Array, coefficients: Array, w: Sweep, sharp: bool, most: int
) -> int:
    """Sweep on until DONE, ASKING, FULL, or PAUSED after ``most`` intervals.

    Args:
        model: The pairs.
        breaks: Breaks of the trajectory, shape (m + 1,) [s].
        coefficients: Coefficients of the trajectory, shape (m, n, k).
        w: The sweep.
        sharp: Whether intervals are halved until the clearance told is sharp, not only until all
            is free.
        most: Intervals to look at.
    """
    w.counters[SHARP] = 1 if sharp else 0
    seen = 0
    while w.counters[TOP] > 0:
        if seen >= most:
            return PAUSED
        seen += 1
        pop_interval(breaks, coefficients, w)
        if moves_far(w):
            pass_on(w, breaks)
            continue
        if not check_interval(model, w):
            w.counters[TOP] += 1
            w.counters[VISITS] -= 1
            return FULL
        if w.counters[PROBE] == 1:
            continue
        if w.counters[REFERRED] > 0:
            return ASKING
        if w.counters[OPEN] > 0:
            push_halves(w, breaks, True)
    return DONE
