"""Corners rounded as widely as can be proved free."""

from collections.abc import Sequence

import numpy as np

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from planning.timing.path.blend import largest_reaches
from planning.values.deadline import Deadline

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
    widest = largest_reaches(waypoints)
    if most is not None:
        widest = np.minimum(widest, most)
    found = np.zeros(len(widest))
    trial = widest.copy()
    for level in (*preferred, checker):
        is_last = level is checker
        halvings = _HALVINGS if is_last else _HALVINGS_PREFERRED
        if deadline.passed or not any(trial.tolist()):
            break
        search = level.round_corners(waypoints, trial, halvings, keep=not is_last, smooth=smooth)
        for done in search:
            np.maximum(found[:done], trial[:done], out=found[:done])
            if deadline.passed:
                break
        if not is_last:
            trial = np.where(found > 0.0, 0.0, widest)
    return found
