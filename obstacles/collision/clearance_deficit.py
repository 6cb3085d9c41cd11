"""The shortfall of a straight motion: what its states lack to the margins, on average."""

import math

import numpy as np

from compiled.kernel import kernel
from compiled.simd import LANES, on_stack
from kinematics.arrays import Array
from kinematics.model.chain import MAX_JOINTS
from obstacles.collision.lanes.check import blocked_lanes, write_states
from obstacles.collision.model.kernel_work import Workspace
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.proximity import closest_in, stand_in


@kernel(allocates=False)
def line_shortfall(
    model: ModelArrays, work: Workspace, a: Array, b: Array, spacing: float, most: float
) -> float:
    """Mean shortfall of the straight motion from a to b, both (n,) [m].

    The motion is divided into parts of equal length, the middles of which are looked at. A state
    that keeps all margins lacks nothing; one that does not, the most that a pair of it lacks.

    Args:
        model: The packed robot and scene, with the margins.
        work: A workspace of the model.
        a: Start of the motion, shape (n,) [rad or m].
        b: End of the motion, shape (n,).
        spacing: Length of a part at most, Euclidean in joint space.
        most: Distance beyond which the answer is infinite: fewer states are checked then [m].
    """
    n, square = a.shape[0], 0.0
    for j in range(n):
        square += (b[j] - a[j]) ** 2
    parts = max(1, math.ceil(math.sqrt(square) / spacing))
    q, shares, total = on_stack(MAX_JOINTS)[:n], on_stack(LANES), 0.0
    for first in range(0, parts, LANES):
        count = min(LANES, parts - first)
        for number in range(count):
            shares[number] = (first + number + 0.5) / parts
        write_states(work, a, b, shares, 0, count)
        near = blocked_lanes(model, work, 0.0, (1 << count) - 1, 0, 0)
        for number in range(count):
            if near >> number & 1 == 0:
                continue
            for j in range(n):
                q[j] = a[j] + shares[number] * (b[j] - a[j])
            work.joints[:] = 0.0
            stand_in(model, work, q)
            nearest, _ = closest_in(model, work, 0.0, True)
            total -= nearest
            if total > most * parts:
                return np.inf
    return total / parts
