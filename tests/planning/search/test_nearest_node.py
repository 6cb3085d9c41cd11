"""Nearest nodes are those that scipy finds."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from planning.search.trees import nearest_node, place_node


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
