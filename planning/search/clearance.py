"""Moving a path away from what it passes, as far as there is room.

Legs that are not proved at the preferred clearance are cut into short ones. Their ends step away
from everything that is nearer than preferred, along the gradients of the distances. Each leg then
counts as one of the highest clearance at which it is proved, and stretches of legs of one clearance
are shortened at that clearance.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array
from obstacles.checker import Checker
from planning.deadline import Deadline
from planning.search.shortcut import shortcut

#: Legs are cut no shorter than this, Euclidean in joint space.
_LEAST_LEG = 0.18
#: Waypoints that a path is cut into at most: more are left as they are.
_MAX_WAYPOINTS = 60
#: Steps of a waypoint away from what is too near.
_STEPS = 4
#: Longest of them, Euclidean in joint space.
_LONGEST_STEP = 0.1
#: Distance that a step gains beyond what is missing, for the legs beside it [m].
_BEYOND = 5e-3
#: Singular values below this part of the largest count as zero in a step.
_RANK_TOLERANCE = 1e-2
#: A path longer than so many times the one before is not taken.
_MAX_DETOUR = 1.07


def keep_clear(levels: Sequence[Checker], waypoints: Array, deadline: Deadline) -> Array:
    """Move a polyline whose legs are proved free to where it keeps the preferred clearance.

    Args:
        levels: Checkers of falling clearance; the legs are proved free by the last.
        waypoints: The polyline, shape (k, n) [rad or m]; its ends stay.
        deadline: When to stop trying.

    Returns:
        A polyline from the same start to the same goal, proved free by the last checker.
    """
    preferred = levels[0]
    if len(levels) < 2:
        return waypoints
    before, spacious = _split(preferred, waypoints)
    if spacious.all():
        return waypoints
    after = before.copy()
    for k in range(1, len(before) - 1):
        if not preferred.valid(before[k]) and not deadline.passed:
            after[k] = _retreat(preferred, before[k])
    after = _proved(levels[-1], before, after)
    moved = (after != before).any(axis=1)
    legs = [
        0 if spacious[k] and not (moved[k] or moved[k + 1]) else _level(levels, *after[k : k + 2])
        for k in range(len(after) - 1)
    ]
    answer = _shortened(levels, after, legs, deadline)
    return answer if _length(answer) <= _MAX_DETOUR * _length(waypoints) else waypoints


def _split(preferred: Checker, waypoints: Array) -> tuple[Array, NDArray[np.bool_]]:
    """The polyline with its legs halved until they keep the preferred clearance; which legs do."""
    points, spacious, open_legs = [waypoints[0]], list[bool](), list(pairwise(waypoints))[::-1]
    while open_legs:
        a, b = open_legs.pop()
        short = float(np.linalg.norm(b - a)) < 2.0 * _LEAST_LEG
        free, middle = preferred.free(a, b), 0.5 * (a + b)
        if short and not free and preferred.valid(a) and preferred.valid(b):
            # Only what lies between its ends is too near.
            points += [middle, b]
            spacious += [False, False]
        elif free or short or len(points) + len(open_legs) >= _MAX_WAYPOINTS:
            points.append(b)
            spacious.append(free)
        else:
            open_legs += [(middle, b), (a, middle)]
    return np.array(points), np.array(spacious)


def _retreat(preferred: Checker, q: Array) -> Array:
    """A configuration near q (n,) that keeps more of the preferred clearance; q where none does."""
    limits = preferred.model.chain.limits
    best, missing = q, np.inf
    for _ in range(_STEPS):
        near = preferred.gradient(q, 0.0)
        if not len(near.distances):
            return q
        worst = -float(near.distances.min())
        if worst < missing:
            best, missing = q, worst
        wanted = _BEYOND - near.distances
        step = np.linalg.lstsq(near.gradients, wanted, rcond=_RANK_TOLERANCE)[0]
        length = float(np.linalg.norm(step))
        if not length > 0.0:
            break
        q = np.clip(q + min(1.0, _LONGEST_STEP / length) * step, limits.lower, limits.upper)
    return q if preferred.valid(q) else best


def _proved(checker: Checker, before: Array, after: Array) -> Array:
    """The points moved where their legs are proved free, and as they were where they are not."""
    moved = (after != before).any(axis=1)
    points = after.copy()
    while True:
        back = False
        for k in range(len(points) - 1):
            if (moved[k] or moved[k + 1]) and not checker.free(points[k], points[k + 1]):
                for i in (k, k + 1):
                    points[i], moved[i], back = before[i], False, True
        if not back:
            return points


def _shortened(
    levels: Sequence[Checker], points: Array, legs: Sequence[int], deadline: Deadline
) -> Array:
    """The polyline with each stretch of legs of one level shortened at that level."""
    answer, first = [points[0]], 0
    for k in range(1, len(points)):
        if k == len(legs) or legs[k] != legs[first]:
            stretch = points[first : k + 1]
            if len(stretch) > 2:
                stretch = shortcut(levels[legs[first]], stretch, deadline)
            answer += list(stretch[1:])
            first = k
    return np.array(answer)


def _level(levels: Sequence[Checker], a: Array, b: Array) -> int:
    """The first level that proves the straight motion from a to b, else the last."""
    return next((k for k, level in enumerate(levels[:-1]) if level.free(a, b)), len(levels) - 1)


def _length(points: Array) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
