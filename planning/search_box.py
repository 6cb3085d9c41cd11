"""Boxes in joint space that random configurations are drawn from."""

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Chain, JointType


def search_box(chain: Chain, known: list[Array]) -> tuple[Array, Array]:
    """Bounds (n,) to draw from: the limits, or a turn beyond what is known where there are none.

    Args:
        chain: The robot.
        known: Configurations that the box must hold, each (n,) [rad or m].
    """
    lower, upper = chain.limits.lower, chain.limits.upper
    low, high = np.min(known, axis=0) - 2.0 * np.pi, np.max(known, axis=0) + 2.0 * np.pi
    return np.where(np.isfinite(lower), lower, low), np.where(np.isfinite(upper), upper, high)


def nearby_box(chain: Chain, known: list[Array]) -> tuple[Array, Array]:
    """The part (n,) of ``search_box`` that is within half a turn of what is known.

    Of joints that can turn further. It has the arm in every place that the whole box has it in,
    by fewer turns: of six joints with 720 degrees each it is a sixty-fourth of the whole.

    Args:
        chain: The robot.
        known: Configurations that the box must hold, each (n,) [rad or m].
    """
    low, high = search_box(chain, known)
    turns = (chain.joint_types == JointType.REVOLUTE) & (high - low > 2.0 * np.pi)
    least, most = np.min(known, axis=0) - np.pi, np.max(known, axis=0) + np.pi
    return np.where(turns, np.maximum(low, least), low), np.where(
        turns, np.minimum(high, most), high
    )
