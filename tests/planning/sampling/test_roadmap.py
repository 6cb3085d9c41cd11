"""Shortest paths through graphs of edges, against Bellman and Ford's iteration."""

import itertools

import numpy as np
import pytest

from kinematics.arrays import Array
from planning.sampling.roadmap import Roadmap


def shortest_length(points: Array, edges: list[tuple[int, int]], goals: list[int]) -> float:
    """Length of the shortest path from point 0 to any goal, by relaxing every edge n times."""
    best = np.full(len(points), np.inf)
    best[0] = 0.0
    for _, (i, j) in itertools.product(range(len(points)), edges):
        length = float(np.linalg.norm(points[i] - points[j]))
        best[j] = min(best[j], best[i] + length)
        best[i] = min(best[i], best[j] + length)
    return float(best[goals].min())


@pytest.mark.parametrize("seed", range(20))
def test_the_shortest_path_to_any_goal(seed: int) -> None:
    random = np.random.default_rng(seed)
    points = random.uniform(-1.0, 1.0, (12, 3))
    goals = [10, 11]
    edges = [(int(i), int(j)) for i, j in random.integers(0, 12, (14, 2)) if i != j]
    roadmap = Roadmap(points[0], [points[k] for k in goals])
    for i, j in edges:
        roadmap.add(points[i], points[j])
    path, length = roadmap.shortest(), shortest_length(points, edges, goals)
    if not np.isfinite(length):
        assert path is None
        return
    assert path is not None
    assert np.array_equal(path[0], points[0])
    assert any(np.array_equal(path[-1], points[k]) for k in goals)
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).sum() == pytest.approx(length)
    joined = {frozenset((points[i].tobytes(), points[j].tobytes())) for i, j in edges}
    for a, b in itertools.pairwise(path):
        assert frozenset((a.tobytes(), b.tobytes())) in joined


def test_without_edges_there_is_no_path_and_repeated_edges_count_once() -> None:
    a, b = np.zeros(2), np.ones(2)
    roadmap = Roadmap(a, [b])
    assert roadmap.shortest() is None
    roadmap.add(a, a)
    assert roadmap.shortest() is None
    # A sparse matrix adds up entries that are given twice: the edge must not become longer.
    for _ in range(3):
        roadmap.add(a, b)
        roadmap.add(b, a)
    detour = np.array([0.0, 1.2])
    roadmap.add(a, detour)
    roadmap.add(detour, b)
    path = roadmap.shortest()
    assert path is not None
    np.testing.assert_array_equal(path, [a, b])
