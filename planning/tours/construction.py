"""The first order of a tour: the nearest goal that may come next, again and again."""

import numpy as np

from kinematics.arrays import Indices
from planning.tours.network import Network, TourState, tour_state


def nearest_neighbour_tour(
    network: Network, groups: Indices, pairs: list[tuple[int, int]]
) -> TourState:
    """A tour that goes to the nearest goal that may come next.

    A goal may come next when all that come before it, or before its group, are visited, and no
    other group is half done.

    Args:
        network: The stops and times.
        groups: Group of each goal, shape (m,).
        pairs: Goals, the first before the second.
    """
    m = len(groups)
    outer: dict[int, set[int]] = {}
    inner: dict[int, set[int]] = {}
    for a, b in pairs:
        if groups[a] == groups[b]:
            inner.setdefault(b, set()).add(a)
        else:
            outer.setdefault(int(groups[b]), set()).add(a)
    members = {int(g): {int(k) for k in np.flatnonzero(groups == g)} for g in groups}
    order, choice = [m], np.zeros(m + 2, dtype=np.int64)
    choice[m:] = network.first[m : m + 2]
    visited: set[int] = set()
    current = int(choice[m])
    while len(visited) < m:
        half_done = len(order) > 1 and bool(members[int(groups[order[-1]])] - visited)
        candidates = [
            k
            for k in range(m)
            if k not in visited
            and (not half_done or groups[k] == groups[order[-1]])
            and inner.get(k, set()) <= visited
            and outer.get(int(groups[k]), set()) <= visited
        ]
        stop, entry = _nearest(network, current, candidates)
        order.append(stop)
        visited.add(stop)
        choice[stop] = current = entry
    return tour_state(np.array([*order, m + 1]), choice)


def _nearest(network: Network, current: int, candidates: list[int]) -> tuple[int, int]:
    """The stop nearest to a configuration, and its nearest configuration."""
    row, first = network.times[current], network.first
    best = min(candidates, key=lambda k: float(row[first[k] : first[k + 1]].min()))
    return best, int(first[best] + row[first[best] : first[best + 1]].argmin())
