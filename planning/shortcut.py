"""Shortening a path by straight cuts, each of them proved free before it is taken."""

from itertools import pairwise

import numpy as np

from kinematics.chain import Array
from obstacles.checker import Checker
from planning.deadline import Deadline

#: Random cuts tried for each waypoint the path came with, between these bounds.
_CUTS_A_WAYPOINT = 12
_LEAST_CUTS = 40
_MOST_CUTS = 240
#: Cuts in a row that gained nothing after which the path counts as short.
_PATIENCE = 40
#: A cut that saves less of the length than this is not worth a corner.
_LEAST_GAIN = 1e-4


def shortcut(checker: Checker, waypoints: Array, seed: int, deadline: Deadline) -> Array:
    """Shorten a polyline (k, n) whose legs are proved free; what comes back is too.

    First waypoints are left out as far as can be, then cuts between random points along the path
    are tried, to a budget counted in cuts, so that the same seed gives the same path. Source:
    "Creating high-quality paths for motion planning", International Journal of Robotics
    Research, 2007.
    """
    points = _skip_waypoints(checker, list(waypoints), deadline)
    random = np.random.default_rng(seed)
    budget = int(np.clip(_CUTS_A_WAYPOINT * len(waypoints), _LEAST_CUTS, _MOST_CUTS))
    idle = 0
    for _ in range(budget):
        if len(points) < 3 or idle >= _PATIENCE or deadline.passed:
            break
        cut = _random_cut(checker, points, random)
        idle = idle + 1 if cut is None else 0
        points = points if cut is None else cut
    return np.array(_skip_waypoints(checker, points, deadline))


def _skip_waypoints(checker: Checker, points: list[Array], deadline: Deadline) -> list[Array]:
    """From each waypoint go straight to the farthest one that a bisection finds in sight."""
    kept = [points[0]]
    at = 0
    while at < len(points) - 1:
        sure, maybe = at + 1, len(points) - 1
        while sure < maybe and not deadline.passed:
            if checker.free(points[at], points[maybe]):
                sure = maybe
            else:
                maybe = (sure + maybe) // 2
        kept.append(points[sure])
        at = sure
    return kept


def _random_cut(
    checker: Checker, points: list[Array], random: np.random.Generator
) -> list[Array] | None:
    lengths = np.array([np.linalg.norm(b - a) for a, b in pairwise(points)])
    ends = np.cumsum(lengths)
    first, last = np.sort(random.uniform(0.0, ends[-1], 2))
    i, j = int(np.searchsorted(ends, first)), int(np.searchsorted(ends, last))
    if i == j:
        return None
    a = _along(points, ends, lengths, i, first)
    b = _along(points, ends, lengths, j, last)
    saved = (last - first) - float(np.linalg.norm(b - a))
    if saved < _LEAST_GAIN * ends[-1] or not checker.free(a, b):
        return None
    return [*points[: i + 1], a, b, *points[j + 1 :]]


def _along(points: list[Array], ends: Array, lengths: Array, leg: int, at: float) -> Array:
    share = 1.0 - (ends[leg] - at) / lengths[leg]
    return np.asarray(points[leg] + share * (points[leg + 1] - points[leg]))
