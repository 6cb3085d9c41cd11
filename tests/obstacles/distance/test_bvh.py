"""Trees of boxes: each item in one leaf, tight boxes, skips past all that is below a node."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from kinematics.arrays import Array
from obstacles.distance.bvh import (
    FIRST,
    LAST,
    SKIP,
    Tree,
    gap,
    tree,
)


def boxes(count: int, seed: int = 0) -> tuple[Array, Array]:
    random = np.random.default_rng(seed)
    low = random.normal(size=(count, 3))
    return low, low + random.uniform(0.0, 0.3, (count, 3))


def items_of(built: Tree, node: int) -> list[int]:
    first, last = built.nodes[node, FIRST : LAST + 1].astype(int)
    return [int(k) for k in built.items[first:last]]


def below(built: Tree, node: int) -> list[int]:
    """All items in the leaves from a node to where its skip leads."""
    nodes = range(node, int(built.nodes[node, SKIP]))
    return [k for n in nodes if built.nodes[n, FIRST] >= 0 for k in items_of(built, n)]


def nearest(built: Tree, points: Array, p: Array) -> tuple[int, int]:
    """The item nearest to p by a walk over the tree, and the leaves that it opened."""
    best, square, node, opened = -1, np.inf, 0, 0
    while node < len(built.nodes):
        if gap(built.nodes, node, p[0], p[1], p[2]) >= square:
            node = int(built.nodes[node, SKIP])
            continue
        if built.nodes[node, FIRST] >= 0.0:
            opened += 1
            for k in items_of(built, node):
                away = float(((points[k] - p) ** 2).sum())
                if away < square:
                    best, square = k, away
        node += 1
    return best, opened


@pytest.mark.parametrize("most", [1, 2, 5])
@pytest.mark.parametrize("count", [1, 2, 3, 7, 64, 301])
def test_every_item_is_in_one_leaf_that_holds_at_most_so_many(count: int, most: int) -> None:
    built = tree(*boxes(count), most)
    assert sorted(below(built, 0)) == list(range(count))
    assert sorted(built.items.tolist()) == list(range(count))
    for node, row in enumerate(built.nodes):
        if row[FIRST] >= 0.0:
            assert 1 <= len(items_of(built, node)) <= most
            assert row[SKIP] == node + 1
        else:
            assert row[LAST] == -1.0
            # Halves of an inner node: the next one, and the one that it skips to.
            middle = int(built.nodes[node + 1, SKIP])
            one, other = below(built, node + 1), below(built, middle)
            assert sorted(one + other) == sorted(below(built, node))
            assert abs(len(one) - len(other)) <= 1
            assert len(one) + len(other) > most
            assert built.nodes[middle, SKIP] == row[SKIP]
    assert built.nodes[0, SKIP] == len(built.nodes)


def test_a_walk_finds_the_nearest_point_and_leaves_most_leaves_closed() -> None:
    random = np.random.default_rng(3)
    points = random.normal(size=(1000, 3))
    built, oracle = tree(points, points), cKDTree(points)
    opened = []
    for p in random.normal(size=(40, 3)) * 2.0:
        found, leaves = nearest(built, points, p)
        assert found == oracle.query(p)[1]
        opened.append(leaves)
    assert np.median(opened) < 100


def test_a_tree_is_the_same_every_time_and_can_not_be_written_to() -> None:
    low, high = boxes(100, 4)
    one, other = tree(low, high), tree(low, high)
    np.testing.assert_array_equal(one.nodes, other.nodes)
    np.testing.assert_array_equal(one.items, other.items)
    for array in one:
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
