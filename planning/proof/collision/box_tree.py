"""Check of the box trees that the proof descends: a wrong box would hide what is below it.

Planners and the proof share the code that grows these trees, so the proof takes nothing of them on
trust: every node must hang below exactly one other, and its box must contain those of its children,
or of the solids in its leaf. A tree whose boxes are wrong gets boxes that are right.
"""

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from obstacles.distance.bvh import BOX, FIRST, LAST, SKIP

_BOX = slice(BOX, BOX + 6)
# What is found of leaves.
LEAVES_ONCE, _LEAVES_APART, LEAVES_LACK = 0, 1, 2
# What is found of nodes.
CONTAINED, WRONG_BOXES, _HANGS_WRONG = 0, 3, 4


class BrokenTree(RuntimeError):
    """A tree of boxes lacks a solid or holds one twice: the program is at fault, not the caller."""


def refuse_broken(found: int) -> None:
    """Refuse a tree by what the kernels below found of it.

    Raises:
        BrokenTree: It does not hold every solid, or node, once.
    """
    if found == _LEAVES_APART:
        raise BrokenTree("the leaves of a tree of boxes do not follow each other")
    if found == LEAVES_LACK:
        raise BrokenTree("a tree of boxes does not hold every solid once")
    if found == _HANGS_WRONG:
        raise BrokenTree("a node of a tree of boxes hangs below none or several")


@kernel(allocates=False, unlocks=False)
def leaf_boxes_kernel(
    nodes: Array, items: Indices, low: Array, high: Array, seen: Indices, boxes: Array
) -> int:
    """Write ``boxes`` (t, 6) of the leaves; what was found. ``seen`` (m,) holds zeros."""
    m = low.shape[0]
    if items.shape[0] != m:
        return _LEAVES_APART
    next_item = 0
    for k in range(nodes.shape[0]):
        for axis in range(3):
            boxes[k, axis], boxes[k, 3 + axis] = np.inf, -np.inf
        if not nodes[k, FIRST] >= 0.0:
            continue
        first, last = int(nodes[k, FIRST]), int(nodes[k, LAST])
        if first != next_item or last <= first or last > m:
            return _LEAVES_APART
        next_item = last
        for entry in range(first, last):
            item = items[entry]
            if item < 0 or item >= m or seen[item] != 0:
                return LEAVES_LACK
            seen[item] = 1
            for axis in range(3):
                boxes[k, axis] = min(boxes[k, axis], low[item, axis])
                boxes[k, 3 + axis] = max(boxes[k, 3 + axis], high[item, axis])
    return LEAVES_ONCE if next_item == m else _LEAVES_APART


def check_nodes(nodes: Array, first: int, roots: Indices, boxes: Array) -> tuple[Array, Indices]:
    """Nodes of one or more trees with boxes that contain everything below them, and their children.

    Args:
        nodes: Shape (t, 10), columns as in ``obstacles.distance.bvh``.
        first: Number that ``SKIP`` of these nodes counts the first of them as.
        roots: Nodes that hang below no other, shape (k,).
        boxes: Lowest and highest corners of the boxes of each leaf's solids, shape (t, 6) [m];
            those of other nodes are not used. They are written over.

    Returns:
        The nodes, shape (t, 10), and both children of each inner node in turn, numbers of nodes.

    Raises:
        BrokenTree: Some node hangs below none or several.
    """
    hung = np.zeros(len(nodes), dtype=np.int64)
    children = np.empty(2 * len(nodes), dtype=np.int64)
    found, count = check_nodes_kernel(nodes, first, roots, hung, boxes, children)
    refuse_broken(found)
    if found == WRONG_BOXES:
        right = nodes.copy()
        right[:, _BOX] = boxes
        nodes = right
    return nodes, children[:count]


@kernel(allocates=False, unlocks=False)
def check_nodes_kernel(
    nodes: Array, first: int, roots: Indices, hung: Indices, boxes: Array, children: Indices
) -> tuple[int, int]:
    """Write the right ``boxes`` (t, 6) of all nodes and their ``children``.

    ``hung`` (t,) holds zeros; in it is counted below how many nodes each one hangs, roots below
    one. What was found, and how many children there are.
    """
    t, count, contained = nodes.shape[0], 0, True
    for root in roots:
        if root < 0 or root >= t:
            return _HANGS_WRONG, 0
        hung[root] += 1
    for k in range(t):
        if nodes[k, FIRST] >= 0.0:
            continue
        if k + 1 >= t:
            return _HANGS_WRONG, 0
        other = int(nodes[k + 1, SKIP]) - first
        if other <= k or other >= t:
            return _HANGS_WRONG, 0
        hung[k + 1] += 1
        hung[other] += 1
        children[count], children[count + 1] = k + 1, other
        count += 2
    for k in range(t):
        if hung[k] != 1:
            return _HANGS_WRONG, 0
    below = count
    # Children come behind their node.
    for k in range(t - 1, -1, -1):
        if not nodes[k, FIRST] >= 0.0:
            below -= 2
            one, other = children[below], children[below + 1]
            for axis in range(3):
                boxes[k, axis] = min(boxes[one, axis], boxes[other, axis])
                boxes[k, 3 + axis] = max(boxes[one, 3 + axis], boxes[other, 3 + axis])
        for axis in range(3):
            if not (
                nodes[k, BOX + axis] <= boxes[k, axis]
                and nodes[k, BOX + 3 + axis] >= boxes[k, 3 + axis]
            ):
                contained = False
    return CONTAINED if contained else WRONG_BOXES, count
