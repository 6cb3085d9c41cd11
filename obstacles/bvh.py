"""A tree of boxes over what stands still, so that most of it is never looked at.

Nodes lie in the order in which a walk meets them; a node that is far away is skipped together with
all below it by going on at its ``skips``. Halved at the median along the longest side:
"Real-time collision detection", chapter 6.
"""

from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.compiled.kernel import kernel

#: Pieces in a leaf: a walk step costs about as much as a look at two of them.
_LEAF = 2


#: What stands in which columns of a node: its box by the lowest and the highest corner, half the
#: diagonal, the node after all below it, and for a leaf from which to before which item it goes
#: (-1: no leaf).
BOX, EXTENT, SKIP, FIRST, LAST = 0, 6, 7, 8, 9
NODE_WIDTH = 10


class Tree(NamedTuple):
    """Boxes over m boxes (t nodes).

    Args:
        nodes: Columns as named above, shape (t, 10).
        items: Numbers of the boxes, by leaf, shape (m,).
    """

    nodes: Array
    items: Indices


@kernel(allocates=False)
def _sort_by_middles(
    low: Array, high: Array, axis: int, items: Indices, spare: Indices, first: int, last: int
) -> None:
    """Sort items[first:last] by the middles of their boxes; equal ones keep their order.

    Runs of sorted items are merged pairwise into the spare array (m,), and copied back.
    """
    width = 1
    while width < last - first:
        for begin in range(first, last, 2 * width):
            half, end = min(begin + width, last), min(begin + 2 * width, last)
            left, right = begin, half
            for at in range(begin, end):
                takes_left = right == end
                if left < half and right < end:
                    a, b = items[left], items[right]
                    takes_left = low[a, axis] + high[a, axis] <= low[b, axis] + high[b, axis]
                if takes_left:
                    spare[at] = items[left]
                    left += 1
                else:
                    spare[at] = items[right]
                    right += 1
        for at in range(first, last):
            items[at] = spare[at]
        width *= 2


@kernel
def _grow(
    low: Array, high: Array, items: Indices, boxes: Array, skips: Indices, spans: Indices, most: int
) -> int:
    """Write the nodes over boxes ``low``, ``high`` (m, 3) and sort ``items`` (m,) by leaf."""
    m = items.shape[0]
    stack = np.empty((128, 2), dtype=np.int64)
    stack[0, 0], stack[0, 1] = 0, m
    least, largest, spare = np.empty(3), np.empty(3), np.empty(m, dtype=np.int64)
    top, made = 1, 0
    while top > 0:
        top -= 1
        first, last = stack[top, 0], stack[top, 1]
        node = made
        made += 1
        spans[node, 0], spans[node, 1] = first, last
        for axis in range(3):
            least[axis], largest[axis] = np.inf, -np.inf
            boxes[node, axis], boxes[node, 3 + axis] = np.inf, -np.inf
        for entry in range(first, last):
            k = items[entry]
            for axis in range(3):
                boxes[node, axis] = min(boxes[node, axis], low[k, axis])
                boxes[node, 3 + axis] = max(boxes[node, 3 + axis], high[k, axis])
                middle = low[k, axis] + high[k, axis]
                least[axis], largest[axis] = min(least[axis], middle), max(largest[axis], middle)
        if last - first <= most:
            continue
        longest = 0
        for axis in range(1, 3):
            if largest[axis] - least[axis] > largest[longest] - least[longest]:
                longest = axis
        _sort_by_middles(low, high, longest, items, spare, first, last)
        half = (first + last) // 2
        stack[top, 0], stack[top, 1] = half, last
        stack[top + 1, 0], stack[top + 1, 1] = first, half
        top += 2
    # All that follow a node and lie in its span are below it.
    for node in range(made - 1, -1, -1):
        after = node + 1
        while after < made and spans[after, 0] < spans[node, 1]:
            after = skips[after]
        skips[node] = after
    for node in range(made):
        if spans[node, 1] - spans[node, 0] > most:
            spans[node, 0], spans[node, 1] = -1, -1
    return made


def tree(low: Array, high: Array, most: int = _LEAF) -> Tree:
    """The tree over boxes from ``low`` to ``high``, both (m, 3), at most so many in a leaf."""
    m = len(low)
    items = np.arange(m, dtype=np.int64)
    room = max(2 * m, 1)
    boxes, skips = np.empty((room, 6)), np.empty(room, dtype=np.int64)
    spans = np.empty((room, 2), dtype=np.int64)
    made = _grow(
        np.ascontiguousarray(low), np.ascontiguousarray(high), items, boxes, skips, spans, most
    )
    made = made if m else 0
    nodes = np.empty((made, NODE_WIDTH))
    nodes[:, BOX : BOX + 6] = boxes[:made]
    nodes[:, EXTENT] = 0.5 * np.linalg.norm(boxes[:made, 3:] - boxes[:made, :3], axis=1)
    nodes[:, SKIP], nodes[:, FIRST : LAST + 1] = skips[:made], spans[:made]
    for array in (nodes, items):
        array.setflags(write=False)
    return Tree(nodes, items)


@kernel(allocates=False)
def gap(nodes: Array, node: int, x: float, y: float, z: float) -> float:
    """Square of the distance of a point from a node's box [m^2]."""
    dx = max(nodes[node, 0] - x, x - nodes[node, 3], 0.0)
    dy = max(nodes[node, 1] - y, y - nodes[node, 4], 0.0)
    dz = max(nodes[node, 2] - z, z - nodes[node, 5], 0.0)
    return float(dx * dx + dy * dy + dz * dz)
