"""Kernels of RRT-Connect: proved between looks, and nearest nodes as scipy finds them."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial import KDTree

from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.search.rrt_connect import rrt_connect
from planning.search.trees import (
    Draws,
    Growth,
    Tally,
    grow_kernel,
    nearest_node,
    new_trees,
    place_node,
)
from planning.values.deadline import Deadline
from planning.values.search_trees import Explored
from tests.planning.scenes import box, builtin

BEFORE, BEHIND = np.array([-0.6, 0.2]), np.array([0.6, 0.2])


def wire() -> Checker:
    """A wire that two links in a plane pass between the looks at a step."""
    at = 1.7 * np.array([np.cos(0.15), 0.0, np.sin(0.15)])
    post = box("wire", (1e-5, 1.0, 1e-5), (at[0], at[1], at[2]))
    return Checker.of(builtin("planar_rr"), Scene((post,)))


def grown(seed: int) -> tuple[np.ndarray, int]:
    """The path between two configurations, and how many steps were cut off."""
    checker, limit = wire(), np.full(2, 3.0)
    roots = np.array([BEFORE, BEHIND])
    draws = Draws(-limit, limit, 9.0, 2.0, 0.0, True, roots, 0.6, 0.7)
    trees = new_trees(2, 2, 2000, np.array([seed], dtype=np.uint64))
    assert grow_kernel(checker.model.arrays, trees, draws, roots, 2000, 2000) == Growth.FOUND
    assert trees.tally[Tally.EDGES] <= 2000
    return trees.path[: trees.tally[Tally.PATH]].copy(), int((trees.parents == -2).sum())


@pytest.mark.parametrize("seed", range(8))
def test_paths_past_what_no_look_finds_are_proved(seed: int) -> None:
    path, _ = grown(seed)
    assert np.array_equal(path[[0, -1]], [BEFORE, BEHIND])
    motion, _ = wire().polyline(path)
    assert motion.free
    again, _ = grown(seed)
    assert np.array_equal(path, again)


def test_steps_over_it_were_taken_and_cut_off() -> None:
    assert sum(cut for _, cut in map(grown, range(8))) > 0


def test_what_is_kept_of_trees_is_proved() -> None:
    checker, explored = wire(), Explored()
    found = rrt_connect(checker, BEFORE, [BEHIND], 0, Deadline.after(30.0), 20_000, explored)
    assert found.waypoints is not None
    assert explored.runs == found.runs
    assert explored.edges
    assert all(checker.free(edge.begin, edge.end) for edge in explored.edges)


def test_a_path_that_need_not_be_proved_is_looked_at_more_closely() -> None:
    """The wire is met by some: what comes after has to prove them."""
    checker, late = wire(), Deadline.after(60.0)
    met = 0
    for seed in range(8):
        found = rrt_connect(checker, BEFORE, [BEHIND], seed, late, 20_000, proves=False)
        path = found.waypoints
        assert path is not None
        assert np.array_equal(path[[0, -1]], [BEFORE, BEHIND])
        shares = np.arange(9) / 8.0
        for a, b in pairwise(path):
            assert all(checker.valid(a + share * (b - a)) for share in shares)
        met += not checker.polyline(path)[0].free
    assert met > 0


@pytest.mark.parametrize("count", [1, 7, 8, 9, 40, 333])
def test_the_nearest_of_some_nodes(count: int) -> None:
    random = np.random.default_rng(count)
    for n in (1, 2, 6, 7, 9):
        nodes = random.normal(size=(count, n))
        blocks = np.full((count + 7) // 8 * 8 * n, np.nan)
        for k, q in enumerate(nodes):
            place_node(blocks, k, q)
        asked = random.normal(size=(50, n))
        away, found = KDTree(nodes).query(asked)
        found = np.asarray(found)
        answers = [nearest_node(blocks, count, q) for q in asked]
        assert [node for node, _ in answers] == found.tolist()
        assert np.allclose([distance for _, distance in answers], away, rtol=1e-14)
        # The first of equals, and none that is nowhere.
        again = np.vstack([nodes, nodes])
        wider = np.full((2 * count + 7) // 8 * 8 * n, np.nan)
        for k, q in enumerate(again):
            place_node(wider, k, q)
        assert [nearest_node(wider, 2 * count, q)[0] for q in asked] == found.tolist()
        for k in range(count):
            place_node(wider, k, np.full(n, np.inf))
        assert [nearest_node(wider, 2 * count, q)[0] for q in asked] == (found + count).tolist()


def test_nothing_is_nearest_where_all_nodes_were_taken_out() -> None:
    blocks = np.empty(8 * 3)
    place_node(blocks, 0, np.zeros(3))
    place_node(blocks, 0, np.full(3, np.inf))
    node, away = nearest_node(blocks, 1, np.ones(3))
    assert (node, away) == (0, np.inf)
