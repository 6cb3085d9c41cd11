"""Ways through narrow passages, first found where these are wider, and followed as they narrow.

A passage that random draws hardly ever hit is wide where solids may get into each other by two
centimetres. A way that is found there guides the draws of the next pair of trees, which allows
less, and so on down to the clearance asked for. Sources: "On finding narrow passages with
probabilistic roadmap planners", Workshop on the Algorithmic Foundations of Robotics, 1998;
"Finding narrow passages with probabilistic roadmaps: the small-step retraction method",
Autonomous Robots, 2005.
"""

import numpy as np

from kinematics.arrays import Array
from planning.search.tree_pairs import Guide, PairOptions, TreePairs

#: How deep solids may be in each other, from one pair of trees to the next [m]. Links are some
#: times as thick as the first, so that no way leads through the middle of one.
_PENETRATIONS = (0.02, 0.015, 0.01, 0.005, 0.0025, 0.0)
#: Longest steps of the first pair, and of those with a guide, Euclidean in joint space.
_FIRST_STEP, _STEP = 1.0, 0.5
#: How far beside the guide draws lie at most in each joint [rad or m], and the share that does.
_WIDTH, _SHARE = 0.6, 0.9


def find_narrow_passage(pairs: TreePairs) -> Array | None:
    """Look for a way with ever less penetration; its path, shape (k, n), if it is found.

    Args:
        pairs: Grow the trees.
    """
    guide = None
    for penetration in _PENETRATIONS[:-1]:
        path = _grow(pairs, penetration, guide)
        if path is None:
            return None
        guide = Guide(_evenly_spread(path), _WIDTH, _SHARE)
    return _grow(pairs, _PENETRATIONS[-1], guide)


def _grow(pairs: TreePairs, penetration: float, guide: Guide | None) -> Array | None:
    """The path that the next pair finds, if there are edges and time for it."""
    if not pairs.may_go_on:
        return None
    step = _FIRST_STEP if guide is None else _STEP
    # Edges that each pair may check.
    return pairs.grow(PairOptions(10_000, step, penetration, guide=guide))


def _evenly_spread(path: Array) -> Array:
    """Points along a path (k, n), as far from each other along it, its ends among them."""
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    # Distance between the points of a guide at most.
    count = max(2, int(np.ceil(along[-1] / 0.25)) + 1)
    at = np.linspace(0.0, along[-1], count)
    return np.ascontiguousarray(np.stack([np.interp(at, along, q) for q in path.T], axis=1))
