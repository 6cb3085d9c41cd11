"""Verdicts on many states of a robot: eight of them abreast, and the few that are left alone."""

import numpy as np

from compiled.kernel import kernel
from compiled.simd import LANES, on_stack
from kinematics.arrays import Array
from obstacles.collision.edge_check import FREE
from obstacles.collision.lanes.check import blocked_lanes
from obstacles.collision.model.kernel_work import Workspace, workspace
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.state_check import verdict_in

#: States from which on a look at eight costs less than one at each.
_FEW = 4
#: All lanes, as bits.
_EVERY = (1 << LANES) - 1


@kernel
def mark_blocked(model: ModelArrays, states: Array, margin: float, blocked: Array) -> None:
    """Write which states are not free: 1 for those, 0 for the others.

    Args:
        model: The packed robot and scene.
        states: Shape (k, n) [rad or m].
        margin: Asked for on top of the pairs' own margins [m].
        blocked: Filled, shape (k,).
    """
    work, k = workspace(model), states.shape[0]
    for first in range(0, k, LANES):
        count = min(LANES, k - first)
        found = _blocked_among(model, work, states, first, count, margin, 0)
        for number in range(count):
            blocked[first + number] = float(found >> number & 1)


@kernel
def any_blocked(model: ModelArrays, states: Array, margin: float) -> bool:
    """Whether any of states (k, n) is not free; those behind the first few that are not looked at.

    Args:
        model: The packed robot and scene.
        states: Shape (k, n) [rad or m].
        margin: Asked for on top of the pairs' own margins [m].
    """
    work, k = workspace(model), states.shape[0]
    for first in range(0, k, LANES):
        count = min(LANES, k - first)
        if _blocked_among(model, work, states, first, count, margin, _EVERY) != 0:
            return True
    return False


@kernel(allocates=False)
def _blocked_among(
    model: ModelArrays, work: Workspace, states: Array, first: int, count: int, margin: float,
    vital: int,
) -> int:  # fmt: skip
    """Verdicts on up to eight states: bits of those that are not free, some if a vital one is not.

    Args:
        model: The packed robot and scene.
        work: A workspace of the model.
        states: Shape (k, n) [rad or m].
        first: The first of those asked about.
        count: How many are.
        margin: Asked for on top of the pairs' own margins [m].
        vital: States, as bits, of which one that is not free will do.
    """
    if count >= _FEW:
        for j in range(states.shape[1]):
            for number in range(LANES):
                # Lanes that are not asked about hold the last state once more.
                work.lanes[LANES * j + number] = states[first + min(number, count - 1), j]
        every = (1 << count) - 1
        return blocked_lanes(model, work, margin, every, every & vital, 0)
    blocked, asked = 0, on_stack(1).view(np.int64)
    for number in range(count):
        if verdict_in(model, work, states[first + number], margin, asked) != FREE:
            blocked |= 1 << number
            if blocked & vital != 0:
                return blocked
    return blocked
