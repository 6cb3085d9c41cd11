"""Check of the box trees that the proof descends: a wrong box would hide what is below it.

Planners and the proof share the code that grows these trees, so the proof takes nothing of them on
trust: every node must hang below exactly one other, and its box must contain those of its children,
or of the solids in its leaf. A tree whose boxes are wrong gets boxes that are right.

Boxes of the elements that the proof compares, and what their holders hold.
"""

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from obstacles.convex.piece import PieceKind
from obstacles.distance.bvh import BOX, FIRST, LAST, SKIP

_HALFSPACE = int(PieceKind.HALFSPACE)
#: What rounding may have taken off a box [relative].
_BOX_ROUNDING = 1e-15


@kernel(allocates=False, unlocks=False)
def solid_boxes_kernel(
    kinds: Indices, poses: Array, boxes: Array, numbers: Indices, low: Array, high: Array
) -> int:
    """Write boxes along the axes that hold the turned boxes of pieces, half-spaces left out.

    Args:
        kinds: Kinds as ``PieceKind``, shape (p,).
        poses: Shape (p, 4, 4).
        boxes: Middles and half sizes of boxes that hold them, in their own frames, shape (p, 6).
        numbers: Filled with those that are no half-spaces, shape (p,).
        low: Filled with their lowest corners, shape (p, 3) [m].
        high: Filled with their highest corners, shape (p, 3) [m].

    Returns:
        How many there are.
    """
    m = 0
    for k in range(kinds.shape[0]):
        if kinds[k] == _HALFSPACE:
            continue
        for row in range(3):
            middle, half = poses[k, row, 3], 0.0
            for axis in range(3):
                middle += poses[k, row, axis] * boxes[k, axis]
                half += abs(poses[k, row, axis]) * boxes[k, 3 + axis]
            low[m, row], high[m, row] = middle - half, middle + half
        numbers[m] = k
        m += 1
    return m


def boxes_of_nodes(nodes: Array) -> Array:
    """Middles and half sizes of nodes' boxes, (t, 6), a hair larger than rounding made them."""
    boxes = np.empty((len(nodes), 6))
    boxes_of_nodes_kernel(nodes, boxes)
    return boxes


@kernel(allocates=False, unlocks=False)
def boxes_of_nodes_kernel(nodes: Array, boxes: Array) -> None:
    """Write ``boxes_of_nodes``."""
    for k in range(nodes.shape[0]):
        for axis in range(3):
            low, high = nodes[k, BOX + axis], nodes[k, BOX + 3 + axis]
            boxes[k, axis] = 0.5 * (low + high)
            boxes[k, 3 + axis] = 0.5 * (high - low) + _BOX_ROUNDING * (abs(low) + abs(high))


@kernel(allocates=False)
def hold_items(
    nodes: Array, items: Indices, children: Indices, margins: Array, below: Indices,
    kids: Indices, most: Array,
) -> None:  # fmt: skip
    """Hang items and nodes below the nodes of a tree.

    Args:
        nodes: Shape (t, 10), columns as in ``obstacles.distance.bvh``.
        items: Items in the order of the leaves, shape (m,).
        children: Nodes below the inner nodes, two of each in turn.
        margins: Margins of all items, by their numbers [m].
        below: Filled with where those below each node start in ``kids``, shape (t + 1,).
        kids: Filled with items, and with nodes counted from -1 down, one node's behind the
            other's, shape (m + t - 1,).
        most: Filled with the largest margin below each node, shape (t,) [m].
    """
    made, inner = 0, 0
    for k in range(nodes.shape[0]):
        below[k], most[k] = made, 0.0
        if nodes[k, FIRST] >= 0.0:
            for entry in range(int(nodes[k, FIRST]), int(nodes[k, LAST])):
                kids[made] = items[entry]
                made += 1
                most[k] = max(most[k], margins[items[entry]])
        else:
            kids[made], kids[made + 1] = -1 - children[inner], -1 - children[inner + 1]
            made, inner = made + 2, inner + 2
    below[nodes.shape[0]] = made
    for k in range(nodes.shape[0] - 1, -1, -1):
        if not nodes[k, FIRST] >= 0.0:
            most[k] = max(most[k + 1], most[int(nodes[k + 1, SKIP])])


def extents(boxes: Array, poses: Array, sizes: Array) -> Array:
    """Size of the largest numbers that elements' places are summed from, shape (e,) [m].

    Args:
        boxes: Middles and half sizes of boxes that hold them, in their own frames, shape (e, 6).
        poses: Poses of the boxes' frames, shape (e, 4, 4).
        sizes: Radius, half height, rounding, shape (e, 3).
    """
    found = np.empty(len(boxes))
    extents_kernel(boxes, poses, sizes, found)
    return found


@kernel(allocates=False, unlocks=False)
def extents_kernel(boxes: Array, poses: Array, sizes: Array, found: Array) -> None:
    """Write ``extents``."""
    for k in range(boxes.shape[0]):
        farthest, place, size = 0.0, 0.0, 0.0
        for axis in range(3):
            farthest += (abs(boxes[k, axis]) + boxes[k, 3 + axis]) ** 2
            place += poses[k, axis, 3] ** 2
            size += sizes[k, axis]
        # A half-space is but a plane through its frame.
        farthest = np.sqrt(farthest) if farthest < np.inf else 0.0
        found[k] = np.sqrt(place) + farthest + size


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
