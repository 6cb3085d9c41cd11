"""Corners rounded as widely as can be proved free."""

import numpy as np

from kinematics.chain import Array
from obstacles.checker import Checker
from planning.deadline import Deadline
from planning.timing.blend import largest_reaches

#: How often a corner's reach is halved before the motion stops there instead.
_HALVINGS = 7


def certified_reaches(checker: Checker, waypoints: Array, deadline: Deadline) -> Array:
    """How far each corner of a polyline can be rounded with its parabola proved free.

    Args:
        checker: The robot in its scene.
        waypoints: Shape (k, n), merged: no repeated or collinear ones, legs proved free.
        deadline: Corners not looked at by then stay sharp.

    Returns:
        Reaches for ``blend``, shape (k - 2,); 0 where nothing but a stop could be proved.
    """
    reaches = largest_reaches(waypoints)
    for i in range(len(reaches)):
        reaches[i] = _certified_reach(checker, waypoints[i : i + 3], float(reaches[i]), deadline)
    return reaches


def _certified_reach(checker: Checker, corner: Array, reach: float, deadline: Deadline) -> float:
    """The widest of the reach's halves whose parabola about the middle waypoint is free."""
    legs = np.diff(corner, axis=0)
    u_in, u_out = legs / np.linalg.norm(legs, axis=1, keepdims=True)
    for _ in range(_HALVINGS):
        if reach <= 0.0 or deadline.passed:
            return 0.0
        start = corner[1] - reach * u_in
        if checker.curve(start, 2.0 * reach * u_in, reach * (u_out - u_in)).free:
            return reach
        reach /= 2.0
    return 0.0
