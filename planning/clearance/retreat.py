"""Retreats: short ways from a start or goal that is too near to something to where there is room.

A path that has to begin or end nearer than preferred is planned between retreats, with the
preferred clearance all along. Its ends are then joined to it by legs that come too near only next
to the start and to the goal.
"""

from collections.abc import Callable
from functools import cache

import numpy as np

from compiled.kernel import direct
from kinematics.arrays import Array
from obstacles.collision.checker import Checker, any_model
from obstacles.collision.model.model_arrays import ModelArrays
from planning.clearance.moving_away import retreat_kernel
from planning.search.sampled_check import Look, look_of

#: A leg to an end may be too near over so many times the length of the retreat from there.
_MAX_PREFIX = 1.3
#: States of a leg that are looked at are this far apart, Euclidean in joint space.
_SPACING = 0.03
#: Places on the legs next to an end that are tried as corners, farthest first: the leg, and how far
#: along it.
_PLACES = ((2, 0.0), (1, 0.5), (1, 0.0), (0, 0.5), (0, 0.25))


def retreat(roomy: Checker, least: Checker, q: Array) -> Array | None:
    """A configuration near another one that keeps more clearance, and is reached straight.

    Args:
        roomy: Has the clearance that is to be kept.
        least: Has that which the straight motion there is proved to keep.
        q: Shape (n,) [rad or m].

    Returns:
        Shape (n,), ``q`` itself where it keeps the clearance; None where none is found.
    """
    if roomy.valid(q):
        return q
    reach, away = roomy.model.chain.limits, np.array(q, np.float64)
    limits = np.array([reach.lower, reach.upper])
    kept = _retreat_directly()(roomy.model.arrays, look_of(roomy), limits, away)
    return away if kept and least.free(q, away) else None


@cache
def _retreat_directly() -> Callable[[ModelArrays, Look, Array, Array], bool]:
    """``retreat_kernel`` without the look at its arguments' types, which would cost too much."""
    look = Look(0.0, 0.0, 0.0)
    return direct(retreat_kernel, any_model(), look, np.zeros((1, 1)), np.zeros(1))


def join_ends(roomy: Checker, least: Checker, start: Array, path: Array, goal: Array) -> Array:
    """A path between retreats with its true ends, each joined as far along it as it can be.

    Args:
        roomy: Has the clearance of the path, which legs to the ends only lack next to these.
        least: Proves those legs.
        start: Whose retreat the path begins at, or where it begins, shape (n,) [rad or m].
        path: Shape (k, n).
        goal: Likewise, shape (n,).
    """
    start_room = _MAX_PREFIX * float(np.linalg.norm(path[0] - start))
    goal_room = _MAX_PREFIX * float(np.linalg.norm(path[-1] - goal))
    if _is_near_at_ends(roomy, start, goal, start_room, goal_room) and least.free(start, goal):
        return np.array([start, goal])
    if start_room > 0.0:
        path = _join(roomy, least, start, path, start_room)
    if goal_room > 0.0:
        path = _join(roomy, least, goal, path[::-1], goal_room)[::-1]
    return np.ascontiguousarray(path)


def _join(roomy: Checker, least: Checker, end: Array, path: Array, room: float) -> Array:
    """The path (k, n) from an end (n,) on, too near by ``room`` from there at most."""
    for leg, share in _PLACES:
        if leg > len(path) - 2:
            continue
        corner = path[leg] + share * (path[leg + 1] - path[leg])
        if _is_near_at_ends(roomy, end, corner, room, 0.0) and least.free(end, corner):
            return np.array([end, corner, *path[leg + 1 :]])
    return np.array([end, *path])


def _is_near_at_ends(roomy: Checker, a: Array, b: Array, begin: float, end: float) -> bool:
    """Whether a leg from a to b, both (n,), is only too near so far from its two ends at most."""
    length = float(np.linalg.norm(b - a))
    if length <= begin + end:
        return False
    first, last = begin / length, 1.0 - end / length
    count = max(2, int(np.ceil((last - first) * length / _SPACING)))
    # As np.linspace, in a third of its time.
    shares: Array = first + np.arange(count + 1.0) * ((last - first) / count)
    return roomy.all_valid(a + shares[:, None] * (b - a))
