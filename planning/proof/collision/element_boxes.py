"""Boxes of the elements that the proof compares, and what their holders hold."""

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
