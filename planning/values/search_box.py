"""Boxes in joint space that random configurations are drawn from."""

from collections.abc import Sequence

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Chain, JointType

_TURN = 2.0 * np.pi


def search_box(
    chain: Chain, known: Sequence[Array] | Array, *, nearby: bool = False
) -> tuple[Array, Array]:
    """Bounds (n,) to draw from: the limits, or a turn beyond what is known where there are none.

    Args:
        chain: The robot.
        known: Configurations that the box must hold, each (n,) [rad or m].
        nearby: Whether joints that can turn further stay within half a turn of what is known. The
            part has the arm in every place that the whole box has it in, by fewer turns: of six
            joints with 720 degrees each it is a sixty-fourth of the whole.
    """
    points, limits = np.array(known, dtype=np.float64), chain.limits
    least, most = points.min(axis=0), points.max(axis=0)
    low = np.where(np.isfinite(limits.lower), limits.lower, least - _TURN)
    high = np.where(np.isfinite(limits.upper), limits.upper, most + _TURN)
    if nearby:
        turns = (chain.joint_types == JointType.REVOLUTE) & (high - low > _TURN)
        low = np.where(turns, np.maximum(low, least - np.pi), low)
        high = np.where(turns, np.minimum(high, most + np.pi), high)
    return low, high
