"""Probabilistic roadmaps: OMPL grows them, the shortest path through them is found here.

OMPL's own search runs in a second thread beside the growing, so its answer depends on how fast
each of them is. Every edge of the roadmap was proved through ``CertifiedEdges``, which keeps them.
"""

from typing import Any

import numpy as np
from ompl import base
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from kinematics.arrays import Array
from planning.sampling.space import CertifiedEdges
from planning.sampling.watch import Watch


class Roadmap:
    """Proved edges as a graph.

    Args:
        start: Configuration, shape (n,) [rad or m].
        goals: Configurations, shape (n,) each.
    """

    def __init__(self, start: Array, goals: list[Array]) -> None:
        self._number: dict[bytes, int] = {}
        self._states: list[Array] = []
        self._ends: list[tuple[int, int]] = []
        self._lengths: list[float] = []
        self._known: set[tuple[int, int]] = set()
        self._start = self._vertex(start)
        self._goals = [self._vertex(goal) for goal in goals]

    def add(self, a: Array, b: Array) -> None:
        """Keep an edge between configurations a and b, both (n,), once."""
        ends = (self._vertex(a), self._vertex(b))
        if ends[0] == ends[1] or ends in self._known:
            return
        self._known |= {ends, ends[::-1]}
        self._ends.append(ends)
        self._lengths.append(float(np.linalg.norm(b - a)))

    def shortest(self) -> Array | None:
        """The shortest path from the start to any goal, shape (k, n), if there is one."""
        if not self._ends:
            return None
        rows, columns = np.array(self._ends).T
        size = len(self._states)
        graph: Any = coo_array((self._lengths, (rows, columns)), shape=(size, size)).tocsr()
        tree = dijkstra(
            graph, directed=False, indices=np.array([self._start]), return_predecessors=True
        )
        far, before = tree[0][0], tree[1][0]
        goal = min(self._goals, key=lambda g: far[g])
        if not np.isfinite(far[goal]):
            return None
        path = [goal]
        while path[-1] != self._start:
            path.append(int(before[path[-1]]))
        return np.array([self._states[v] for v in reversed(path)])

    def _vertex(self, q: Array) -> int:
        key = q.tobytes()
        if key not in self._number:
            self._number[key] = len(self._states)
            self._states.append(q)
        return self._number[key]


def grow_roadmap(
    solver: Any, edges: CertifiedEdges, start: Array, goals: list[Array], watch: Watch, *, on: bool
) -> Array | None:
    """Grow a roadmap until it connects start and goal, or go ``on`` as long as there is time.

    Returns:
        The shortest path, shape (k, n), if there is one.
    """
    edges.proved = []
    roadmap = Roadmap(start, goals)
    # Told to stop at once, OMPL takes in the start and one more goal each time and does no more.
    for _ in goals:
        solver.solve(base.plannerAlwaysTerminatingCondition())
    best = None
    # Edges at which the roadmap is searched first; then whenever it has grown by a fifth.
    search_at = 8

    def pause() -> bool:
        return watch() or edges.count >= search_at

    while True:
        for a, b in edges.proved:
            roadmap.add(a, b)
        edges.proved.clear()
        path = roadmap.shortest()
        if path is not None:
            best = path
            watch.note(float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()))
            if not on:
                watch.reason = watch.reason or "solved"
        if watch.reason is not None:
            return best
        search_at = int(1.2 * max(search_at, edges.count)) + 1
        solver.growRoadmapPtc(base.PlannerTerminationCondition(pause))
