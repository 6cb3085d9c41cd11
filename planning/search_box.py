"""The box in joint space that random configurations are drawn from."""

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Chain


def search_box(chain: Chain, known: list[Array]) -> tuple[Array, Array]:
    """Bounds (n,) to draw from: the limits, or a turn beyond what is known where there are none.

    Args:
        chain: The robot.
        known: Configurations that the box must hold, each (n,) [rad or m].
    """
    lower, upper = chain.limits.lower, chain.limits.upper
    low, high = np.min(known, axis=0) - 2.0 * np.pi, np.max(known, axis=0) + 2.0 * np.pi
    return np.where(np.isfinite(lower), lower, low), np.where(np.isfinite(upper), upper, high)
