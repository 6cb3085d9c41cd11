"""Verdicts on many states of a robot: eight of them abreast, and the few that are left alone."""

import numpy as np

from kinematics.arrays import Array
from kinematics.compiled.kernel import kernel
from kinematics.compiled.simd import LANES
from obstacles.edge_check import FREE
from obstacles.kernel_work import workspace
from obstacles.lane_check import blocked_lanes
from obstacles.model_arrays import ModelArrays
from obstacles.state_check import verdict_in

#: States from which on a look at eight costs less than one at each.
_FEW = 4


@kernel
def mark_blocked(model: ModelArrays, states: Array, margin: float, blocked: Array) -> None:
    """Write which states are not free: 1 for those, 0 for the others.

    Args:
        model: The packed robot and scene.
        states: Shape (k, n) [rad or m].
        margin: Asked for on top of the pairs' own margins [m].
        blocked: Filled, shape (k,).
    """
    work, asked, k = workspace(model), np.empty(1, dtype=np.int64), states.shape[0]
    for first in range(0, k, LANES):
        count = min(LANES, k - first)
        if count < _FEW:
            for row in range(first, k):
                verdict = verdict_in(model, work, states[row], margin, asked)
                blocked[row] = 0.0 if verdict == FREE else 1.0
            return
        for j in range(states.shape[1]):
            for number in range(LANES):
                # Lanes that are not asked about hold the last state once more.
                work.lanes[LANES * j + number] = states[first + min(number, count - 1), j]
        found = blocked_lanes(model, work, margin, (1 << count) - 1, 0, 0)
        for number in range(count):
            blocked[first + number] = float(found >> number & 1)
