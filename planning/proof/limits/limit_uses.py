"""Use of limits by a motion: of position, velocity, acceleration and jerk, from their extrema.

Violation of what a motion has to keep, as a value.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from compiled.kernel import direct, directly, kernel
from kinematics.arrays import Array, Indices
from kinematics.trajectory.trajectory import Trajectory
from planning.proof.extrema import (
    BOUND,
    MAX_DEPTH,
    TIED,
    TIME,
    VALUE,
    extrema_kernel,
    largest_jump,
)

#: A violation this near to the start or the goal, in every joint, is told as theirs [rad or m].
_AT_AN_END = 1e-6


@dataclass(frozen=True, slots=True)
class Violation:
    """First thing that is wrong with a trajectory.

    Args:
        kind: "collision", "undecided", "position", "velocity", "acceleration", "jerk", "torque",
            "tool_speed", "path_constraint", "path_deviation", "continuity", "start", "goal",
            "unproved" or "time".
        time: Begin of the violation [s]; of "torque", "tool_speed" and "path_deviation", its worst
            instant.
        message: One sentence.
        details: Values a program can use.
    """

    kind: str
    time: float
    message: str
    details: Mapping[str, Any]


def at_an_end(trajectory: Trajectory, q: Array) -> str | None:
    """Whether a configuration (n,) is the "start" or the "goal" of a motion; None for neither."""
    for where, end in (("start", trajectory.start), ("goal", trajectory.end)):
        if np.abs(q - end).max() <= _AT_AN_END:
            return where
    return None


# Columns of ``LimitUses.uses``.
RATIO, JOINT, AT, EXCESS, BEYOND = range(5)


class LimitUses(NamedTuple):
    """Use of limits by position and the first derivatives, joint by joint and the worst of each.

    Args:
        uses: Use of each order: the largest share of a range that is used, from its middle; whose
            and when [s]; how far a bound is beyond its limit, as a share of it, for positions in
            their own unit; whose; shape (orders, 5).
        highest: Largest value, its time and a bound of it, shape (orders, n, 3).
        lowest: Least values, shaped as the largest ones.
    """

    uses: Array
    highest: Array
    lowest: Array


def limit_uses(trajectory: Trajectory, lower: Array, upper: Array) -> LimitUses:
    """Use of limits by a motion and its derivatives, and all their extrema.

    Args:
        trajectory: The motion.
        lower: Lower limits of positions, velocities, ..., infinite for none, shape (orders, n).
        upper: Upper ones.
    """
    orders, n = lower.shape
    found = LimitUses(np.empty((orders, 5)), np.empty((orders, n, 3)), np.empty((orders, n, 3)))
    stack = np.empty((MAX_DEPTH + 2, trajectory.coefficients.shape[2] + 3))
    motion = trajectory.breaks, trajectory.coefficients
    directly(limit_uses_kernel, *motion, lower, upper, stack, found)
    return found


class MotionUses(NamedTuple):
    """Use of a motion's limits of position, velocity, acceleration and jerk.

    Args:
        found: Uses of the orders up to the last that is limited; of jerk beside the jumps, where
            the acceleration jumps.
        lower: Lower limits, shape (4, n); infinite where there is none.
        upper: Upper limits.
        limited: Kind of each order, UNLIMITED, LIMITED or JUMPING, shape (4,).
    """

    found: LimitUses
    lower: Array
    upper: Array
    limited: Indices


# What ``MotionUses`` says of an order.
UNLIMITED = 0
LIMITED = 1
#: The derivative before it jumps, so that it has no bound.
JUMPING = 2


def motion_uses(trajectory: Trajectory, limits: Array, most_jump: float) -> MotionUses:
    """Use of the limits of a motion.

    Args:
        trajectory: The motion.
        limits: Lower and upper positions, velocities, accelerations and jerks, shape (5, n); of
            derivatives NaN and infinity bind nothing.
        most_jump: Jump of the acceleration beyond which jerk has no bound.
    """
    return _motion_uses()(trajectory.breaks, trajectory.coefficients, limits, most_jump)


@cache
def _motion_uses() -> Callable[[Array, Array, Array, float], MotionUses]:
    """``motion_uses_kernel`` without the look at its arguments' types."""
    return direct(motion_uses_kernel, np.zeros(2), np.zeros((1, 1, 1)), np.zeros((5, 1)), 0.0)


@kernel
def motion_uses_kernel(
    breaks: Array, coefficients: Array, limits: Array, most_jump: float
) -> MotionUses:
    """``motion_uses``."""
    n = limits.shape[1]
    lower, upper, limited = np.empty((4, n)), np.empty((4, n)), np.zeros(4, np.int64)
    limited[0], orders = LIMITED, 1
    for j in range(n):
        lower[0, j], upper[0, j] = limits[0, j], limits[1, j]
    for order in range(1, 4):
        for j in range(n):
            bound = limits[order + 1, j]
            if np.isfinite(bound):
                limited[order] = LIMITED
            upper[order, j] = bound if np.isfinite(bound) else np.inf
            lower[order, j] = -upper[order, j]
        if order == 3 and limited[order] and largest_jump(breaks, coefficients, 2) > most_jump:
            limited[order] = JUMPING
        if limited[order]:
            orders = order + 1
    found = LimitUses(np.empty((orders, 5)), np.empty((orders, n, 3)), np.empty((orders, n, 3)))
    stack = np.empty((MAX_DEPTH + 2, coefficients.shape[2] + 3))
    limit_uses_kernel(breaks, coefficients, lower[:orders], upper[:orders], stack, found)
    return MotionUses(found, lower, upper, limited)


@kernel(allocates=False)
def limit_uses_kernel(
    breaks: Array, coefficients: Array, lower: Array, upper: Array, stack: Array, found: LimitUses
) -> None:
    """Write ``limit_uses``."""
    for order in range(lower.shape[0]):
        highest, lowest, use = found.highest[order], found.lowest[order], found.uses[order]
        extrema_kernel(breaks, coefficients, order, stack, highest, lowest)
        use[RATIO], use[JOINT], use[AT], use[EXCESS], use[BEYOND] = -1.0, 0.0, 0.0, -np.inf, 0.0
        for j in range(lower.shape[1]):
            half = 0.5 * (upper[order, j] - lower[order, j])
            unit = 1.0 if order == 0 else half
            excess = max(highest[j, BOUND] - upper[order, j], lowest[j, BOUND] + lower[order, j])
            excess = excess / unit if half < np.inf or order == 0 else -np.inf
            # What is no number is beyond all limits.
            excess = np.inf if np.isnan(excess) else excess
            if excess > use[EXCESS]:
                use[EXCESS], use[BEYOND] = excess, j
            middle = 0.5 * (upper[order, j] + lower[order, j])
            ratio, time = 0.0, highest[j, TIME]
            if 0.0 < half < np.inf:
                above, below = highest[j, VALUE] - middle, lowest[j, VALUE] + middle
                ratio = max(above, below) / half
                if abs(above - below) <= TIED * half:
                    time = min(highest[j, TIME], lowest[j, TIME])
                elif below > above:
                    time = lowest[j, TIME]
            if ratio > use[RATIO] + TIED:
                use[JOINT], use[AT] = j, time
            use[RATIO] = max(use[RATIO], ratio)
