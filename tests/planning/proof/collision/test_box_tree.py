"""Trees of boxes that the proof does not take on trust."""

import numpy as np
import pytest

from kinematics.arrays import Array
from obstacles.distance.bvh import BOX, FIRST, SKIP, tree
from planning.proof.collision.box_tree import BrokenTree, check_nodes, leaf_boxes

ROOT = np.zeros(1, dtype=np.int64)


def boxes(seed: int, m: int) -> tuple[Array, Array]:
    """Lowest and highest corners of random boxes, shape (m, 3)."""
    rng = np.random.default_rng(seed)
    middle, half = rng.normal(size=(m, 3)), rng.uniform(0.01, 0.3, size=(m, 3))
    return middle - half, middle + half


@pytest.mark.parametrize("m", [1, 2, 3, 7, 64, 501])
def test_a_right_tree_is_taken_as_it_is(m: int) -> None:
    low, high = boxes(m, m)
    grown = tree(low, high)
    of_leaves = leaf_boxes(grown.nodes, grown.items, low, high)
    assert check_nodes(grown.nodes, 0, ROOT, of_leaves)[0] is grown.nodes


@pytest.mark.parametrize("m", [1, 3, 64])
@pytest.mark.parametrize("seed", range(10))
def test_wrong_boxes_become_boxes_that_contain_everything(seed: int, m: int) -> None:
    low, high = boxes(seed, m)
    grown = tree(low, high)
    rng = np.random.default_rng(seed)
    lying = grown.nodes.copy()
    k = int(rng.integers(len(lying)))
    lying[k, BOX + 2] += 50.0
    lying[k, BOX + 5] += 50.0
    of_leaves = leaf_boxes(lying, grown.items, low, high)
    right, _ = check_nodes(lying, 0, ROOT, of_leaves)
    assert np.allclose(right[0, BOX : BOX + 3], low.min(axis=0))
    assert np.allclose(right[0, BOX + 3 : BOX + 6], high.max(axis=0))
    assert np.allclose(right[:, BOX : BOX + 6], grown.nodes[:, BOX : BOX + 6])


def test_a_tree_that_lacks_a_solid_is_refused() -> None:
    low, high = boxes(0, 20)
    grown = tree(low, high)
    items = grown.items.copy()
    items[3] = items[4]
    with pytest.raises(BrokenTree, match="every solid once"):
        leaf_boxes(grown.nodes, items, low, high)
    with pytest.raises(BrokenTree, match="follow each other"):
        leaf_boxes(grown.nodes, grown.items, *boxes(1, 21))


def test_a_node_below_none_is_refused() -> None:
    low, high = boxes(0, 40)
    grown = tree(low, high)
    nodes = grown.nodes.copy()
    inner = int(np.flatnonzero(nodes[:, FIRST] < 0.0)[0])
    nodes[inner + 1, SKIP] = len(nodes) - 1
    of_leaves = leaf_boxes(nodes, grown.items, low, high)
    with pytest.raises(BrokenTree, match="below none or several"):
        check_nodes(nodes, 0, ROOT, of_leaves)
