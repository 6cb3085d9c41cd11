"""Boxes of the elements that the proof compares, and what their holders hold."""

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.compiled.kernel import kernel
from obstacles.bvh import BOX, FIRST, LAST, SKIP

#: What rounding may have taken off a box [relative].
_BOX_ROUNDING = 1e-15


def placed_boxes(poses: Array, boxes: Array, chosen: Indices) -> tuple[Array, Array]:
    """Boxes along the axes that hold turned boxes.

    Args:
        poses: Of all pieces, shape (p, 4, 4).
        boxes: Middles and half sizes of boxes that hold them, in their own frames, shape (p, 6).
        chosen: Those that are asked for, shape (m,).

    Returns:
        Lowest and highest corners, shape (m, 3) each [m].
    """
    low, high = np.empty((len(chosen), 3)), np.empty((len(chosen), 3))
    placed_boxes_kernel(poses, boxes, chosen, low, high)
    return low, high


@kernel(allocates=False, unlocks=False)
def placed_boxes_kernel(
    poses: Array, boxes: Array, chosen: Indices, low: Array, high: Array
) -> None:
    """Write ``placed_boxes``."""
    for entry in range(chosen.shape[0]):
        k = chosen[entry]
        for row in range(3):
            middle, half = poses[k, row, 3], 0.0
            for axis in range(3):
                middle += poses[k, row, axis] * boxes[k, axis]
                half += abs(poses[k, row, axis]) * boxes[k, 3 + axis]
            low[entry, row], high[entry, row] = middle - half, middle + half


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


def hold_items(
    nodes: Array, items: Indices, children: Indices, margins: Array
) -> tuple[Indices, Indices, Array]:
    """Elements directly below the nodes of a tree.

    Args:
        nodes: Shape (t, 10), columns as in ``obstacles.bvh``.
        items: Elements in the order of the leaves, shape (m,).
        children: Elements below the inner nodes, two of each in turn.
        margins: Of the items, in the same order, shape (m,) [m].

    Returns:
        How many hang below each node, shape (t,), which, one node's behind the other's, and the
        largest margin below each node, shape (t,) [m].
    """
    t = len(nodes)
    spans, kids = np.empty(t, dtype=np.int64), np.empty(len(items) + len(children), dtype=np.int64)
    most = np.empty(t)
    hold_items_kernel(nodes, items, children, margins, spans, kids, most)
    return spans, kids, most


@kernel(allocates=False, unlocks=False)
def hold_items_kernel(
    nodes: Array, items: Indices, children: Indices, margins: Array, spans: Indices,
    kids: Indices, most: Array,
) -> None:  # fmt: skip
    """Write ``hold_items``."""
    made, inner = 0, 0
    for k in range(nodes.shape[0]):
        most[k] = 0.0
        if nodes[k, FIRST] >= 0.0:
            first, last = int(nodes[k, FIRST]), int(nodes[k, LAST])
            spans[k] = last - first
            for entry in range(first, last):
                kids[made] = items[entry]
                made += 1
                most[k] = max(most[k], margins[entry])
        else:
            spans[k] = 2
            kids[made], kids[made + 1] = children[inner], children[inner + 1]
            made, inner = made + 2, inner + 2
    for k in range(nodes.shape[0] - 1, -1, -1):
        if not nodes[k, FIRST] >= 0.0:
            most[k] = max(most[k + 1], most[int(nodes[k + 1, SKIP])])


def extents(boxes: Array, poses: Array, sizes: Array) -> Array:
    """Size of the largest numbers that elements' places are summed from, shape (e,) [m].

    Args:
        boxes: Middles and half sizes of boxes that hold them, in their own frames, shape (e, 6).
        poses: Of these frames, shape (e, 4, 4).
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
