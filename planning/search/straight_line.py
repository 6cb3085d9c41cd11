"""The first rung of the ladder: go straight in joint space."""

import numpy as np

from kinematics.arrays import Array
from obstacles.checker import Checker, Motion


def straight_line(
    checker: Checker, start: Array, goals: list[Array]
) -> tuple[Array | None, list[Motion]]:
    """Try the straight joint motion to each goal in turn.

    Args:
        checker: The robot in its scene.
        start: Shape (n,).
        goals: Configurations (n,), the most wanted first.

    Returns:
        The two ends of the first motion that is proved free, or None, and what was found out
        about each.
    """
    motions = []
    for goal in goals:
        motion = checker.segment(start, goal)
        motions.append(motion)
        if motion.free:
            return np.array([start, goal]), motions
    return None, motions
