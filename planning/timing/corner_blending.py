"""Corners rounded as widely as can be proved free."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from kinematics.arrays import Array
from obstacles.checker import Checker
from planning.deadline import Deadline
from planning.timing.blend import largest_reaches

#: How often a corner's reach is halved before the motion stops there instead.
_HALVINGS = 7
#: Reaches tried at a corner to keep a preferred clearance: narrower ones cost much time.
_HALVINGS_PREFERRED = 3


def certified_reaches(
    checker: Checker,
    waypoints: Array,
    deadline: Deadline,
    *,
    smooth: bool = False,
    most: Array | None = None,
    preferred: Sequence[Checker] = (),
) -> Array:
    """Largest reach of each corner of a polyline whose curve is proved free.

    Args:
        checker: The robot in its scene.
        waypoints: Shape (k, n), merged: no repeated or collinear ones, legs proved free.
        deadline: Corners not looked at by then stay sharp.
        smooth: Whether cubics round the corners, as in ``blend``, or parabolas.
        most: Largest reaches asked for, shape (k - 2,).
        preferred: Checkers of falling clearance that are tried first at corners that keep it.

    Returns:
        Reaches for ``blend``, shape (k - 2,); 0 where nothing but a stop could be proved.
    """
    reaches = largest_reaches(waypoints)
    if most is not None:
        reaches = np.minimum(reaches, most)
    free = _cubics_free if smooth else _parabola_free
    for i in range(len(reaches)):
        corner, legs = waypoints[i + 1], np.diff(waypoints[i : i + 3], axis=0)
        u = legs / np.linalg.norm(legs, axis=1, keepdims=True)
        widest, reach = float(reaches[i]), 0.0
        for level in preferred:
            if level.valid(corner):
                proved = partial(free, level, corner, u)
                reach = _largest(proved, widest, _HALVINGS_PREFERRED, deadline)
            if reach > 0.0:
                break
        else:
            reach = _largest(partial(free, checker, corner, u), widest, _HALVINGS, deadline)
        reaches[i] = 0.0 if deadline.passed else reach
    return reaches


def _largest(
    free: Callable[[float], bool], reach: float, halvings: int, deadline: Deadline
) -> float:
    """The first of a reach, its half, its quarter, ... whose curve is free; 0 where none is."""
    for _ in range(halvings):
        if reach <= 0.0 or deadline.passed or free(reach):
            return reach
        reach /= 2.0
    return 0.0


def _parabola_free(checker: Checker, corner: Array, u: Array, reach: float) -> bool:
    start = corner - reach * u[0]
    return checker.curve(start, 2.0 * reach * u[0], reach * (u[1] - u[0])).free


def _cubics_free(checker: Checker, corner: Array, u: Array, reach: float) -> bool:
    """Whether both cubics are; the second one is looked at backwards."""
    bend, none = reach * (u[1] - u[0]) / 6.0, np.zeros_like(corner)
    return all(
        checker.curve(corner - reach * away, reach * away, none, bend).free
        for away in (u[0], -u[1])
    )
