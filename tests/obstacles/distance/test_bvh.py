"""Trees of boxes: each item in one leaf, tight boxes, skips past all that is below a node."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from kinematics.arrays import Array, Indices
from obstacles.distance.bvh import (
    EXTENT,
    FIRST,
    LAST,
    NODE_WIDTH,
    SKIP,
    Tree,
    gap,
    node_count,
    tree,
)
from tests.properties import numbers


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


def leaf_order(low: Array, high: Array, items: Indices, most: int) -> list[int]:
    """Items halved at the median along the longest side of their middles, sorted by numpy."""
    if len(items) <= most:
        return [int(k) for k in items]
    middles = low[items] + high[items]
    along = middles[:, int(np.argmax(np.ptp(middles, axis=0)))]
    items = items[np.argsort(along, kind="stable")]
    half = len(items) // 2
    return leaf_order(low, high, items[:half], most) + leaf_order(low, high, items[half:], most)


@pytest.mark.parametrize("count", [1, 2, 3, 7, 64, 301])
def test_equal_middles_keep_their_order(count: int) -> None:
    low, high = boxes(count, 5)
    low, high = np.round(low), np.round(low) + 1.0  # many of them equal
    assert tree(low, high, 2).items.tolist() == leaf_order(low, high, np.arange(count), 2)


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


@pytest.mark.parametrize("count", [1, 2, 50, 200])
def test_the_box_of_a_node_is_that_of_what_is_below_it(count: int) -> None:
    low, high = boxes(count, 1)
    built = tree(low, high)
    for node, row in enumerate(built.nodes):
        own = below(built, node)
        np.testing.assert_array_equal(row[:3], low[own].min(axis=0))
        np.testing.assert_array_equal(row[3:6], high[own].max(axis=0))
        assert row[EXTENT] == pytest.approx(np.linalg.norm(row[3:6] - row[:3]) / 2.0)


def test_it_is_halved_across_its_longest_side_at_the_median() -> None:
    random = np.random.default_rng(2)
    for axis in range(3):
        low = random.uniform(size=(64, 3)) * np.where(np.arange(3) == axis, 10.0, 1.0)
        built = tree(low, low)
        first, second = below(built, 1), below(built, int(built.nodes[1, SKIP]))
        assert low[first, axis].max() <= low[second, axis].min()
        assert len(first) == len(second) == 32


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


def test_no_boxes_make_no_nodes() -> None:
    built = tree(np.zeros((0, 3)), np.zeros((0, 3)))
    assert built.nodes.shape == (0, NODE_WIDTH)
    assert len(built.items) == 0


@pytest.mark.parametrize("count", [5, 1000])
def test_equal_boxes_are_halved_too(count: int) -> None:
    """Nothing tells them apart: by number they still come to a shallow tree."""
    low = np.zeros((count, 3))
    built = tree(low, low + 1.0)
    assert sorted(below(built, 0)) == list(range(count))
    depth, waiting = 0, [(0, 1)]
    while waiting:
        node, level = waiting.pop()
        depth = max(depth, level)
        if built.nodes[node, FIRST] < 0.0:
            waiting += [(node + 1, level + 1), (int(built.nodes[node + 1, SKIP]), level + 1)]
    assert depth <= np.ceil(np.log2(count)) + 1


def test_a_tree_is_the_same_every_time_and_can_not_be_written_to() -> None:
    low, high = boxes(100, 4)
    one, other = tree(low, high), tree(low, high)
    np.testing.assert_array_equal(one.nodes, other.nodes)
    np.testing.assert_array_equal(one.items, other.items)
    for array in one:
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_given_arrays_need_not_be_contiguous() -> None:
    low, high = boxes(60, 5)
    wide = np.hstack([low, high])
    np.testing.assert_array_equal(tree(wide[:, :3], wide[:, 3:]).nodes, tree(low, high).nodes)


@given(numbers(3, 2.0), numbers(3), numbers(3).map(np.abs), st.booleans())
def test_the_gap_is_the_square_of_the_distance_from_the_box(
    p: Array, low: Array, size: Array, flat: bool
) -> None:
    high = low if flat else low + size
    nodes = tree(low[None], high[None]).nodes
    clipped = np.clip(p, low, high)
    assert gap(nodes, 0, p[0], p[1], p[2]) == pytest.approx(((p - clipped) ** 2).sum(), abs=1e-15)
    assert gap(nodes, 0, clipped[0], clipped[1], clipped[2]) == 0.0


@pytest.mark.parametrize("most", [1, 2, 5])
def test_nodes_are_counted_before_there_are_any(most: int) -> None:
    random = np.random.default_rng(9)
    for count in (*range(40), 333, 1000):
        low = random.normal(size=(count, 3))
        assert node_count(count, most) == len(tree(low, low + 1.0, most).nodes)
