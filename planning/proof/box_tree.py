"""Check of the box trees that the proof descends: a wrong box would hide what is below it.

Planners and the proof share the code that grows these trees, so the proof takes nothing of them on
trust: every node must hang below exactly one other, and its box must contain those of its children,
or of the solids in its leaf. A tree whose boxes are wrong gets boxes that are right.
"""

import numpy as np

from kinematics.arrays import Array, Indices
from obstacles.bvh import BOX, FIRST, LAST, SKIP

_LOW = slice(BOX, BOX + 3)
_HIGH = slice(BOX + 3, BOX + 6)


class BrokenTree(RuntimeError):
    """A tree of boxes lacks a solid or holds one twice: the program is at fault, not the caller."""


def leaf_boxes(nodes: Array, items: Indices, low: Array, high: Array) -> tuple[Array, Array]:
    """Boxes of the solids in each leaf of a tree over boxes.

    Args:
        nodes: Shape (t, 10), columns as in ``obstacles.bvh``.
        items: Numbers of the solids, by leaf, shape (m,).
        low: Lowest corners of the solids' boxes, shape (m, 3) [m].
        high: Highest corners, shape (m, 3) [m].

    Returns:
        Lowest and highest corners, shape (t, 3); inf and -inf of nodes that are no leaves.

    Raises:
        BrokenTree: Some solid is in no leaf, or in several.
    """
    leaf = np.flatnonzero(nodes[:, FIRST] >= 0.0)
    first, last = nodes[leaf, FIRST].astype(np.int64), nodes[leaf, LAST].astype(np.int64)
    joined = np.array_equal(first[1:], last[:-1]) and (first < last).all()
    if not (joined and len(leaf) and first[0] == 0 and last[-1] == len(low)):
        raise BrokenTree("the leaves of a tree of boxes do not follow each other")
    if not np.array_equal(np.sort(items), np.arange(len(low))):
        raise BrokenTree("a tree of boxes does not hold every solid once")
    lowest, highest = np.full((len(nodes), 3), np.inf), np.full((len(nodes), 3), -np.inf)
    lowest[leaf] = np.minimum.reduceat(low[items], first)
    highest[leaf] = np.maximum.reduceat(high[items], first)
    return lowest, highest


def check_nodes(
    nodes: Array, first: int, roots: Indices, low: Array, high: Array
) -> tuple[Array, Indices]:
    """Nodes of one or more trees with boxes that contain everything below them, and their children.

    Args:
        nodes: Shape (t, 10), columns as in ``obstacles.bvh``.
        first: What ``SKIP`` of these nodes counts the first of them as.
        roots: Nodes that hang below no other, shape (k,).
        low: Lowest corners of the boxes of each leaf's solids, shape (t, 3) [m]; those of other
            nodes are not used.
        high: Highest corners, shape (t, 3) [m].

    Returns:
        The nodes, shape (t, 10), and both children of each inner node in turn, numbers of nodes.

    Raises:
        BrokenTree: Some node hangs below none or several.
    """
    inner = np.flatnonzero(nodes[:, FIRST] < 0.0)
    one, other = _children(nodes, first, inner)
    below = np.sort(np.concatenate([roots, one, other]))
    if not (np.array_equal(below, np.arange(len(nodes))) and (other > inner).all()):
        raise BrokenTree("a node of a tree of boxes hangs below none or several")
    children = np.column_stack((one, other)).reshape(-1)
    leaf = nodes[:, FIRST] >= 0.0
    lowest, highest = nodes[:, _LOW], nodes[:, _HIGH]
    contained = (
        (lowest[leaf] <= low[leaf]).all()
        and (highest[leaf] >= high[leaf]).all()
        and (lowest[inner] <= np.minimum(lowest[one], lowest[other])).all()
        and (highest[inner] >= np.maximum(highest[one], highest[other])).all()
    )
    if contained:
        return nodes, children
    right = nodes.copy()
    right[leaf, _LOW], right[leaf, _HIGH] = low[leaf], high[leaf]
    # Children come behind their node.
    for node, a, b in zip(inner[::-1], one[::-1], other[::-1], strict=True):
        right[node, _LOW] = np.minimum(right[a, _LOW], right[b, _LOW])
        right[node, _HIGH] = np.maximum(right[a, _HIGH], right[b, _HIGH])
    return right, children


def _children(nodes: Array, first: int, inner: Indices) -> tuple[Indices, Indices]:
    """First and second child of each inner node."""
    if not len(inner):
        return inner, inner
    other = nodes[np.minimum(inner + 1, len(nodes) - 1), SKIP].astype(np.int64) - first
    return inner + 1, other
