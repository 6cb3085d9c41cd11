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
#: Spans that wait while others are halved: one a level of a tree, which halves what it holds.
_DEEPEST = 128


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


@kernel(allocates=False, unlocks=False)
def grow_kernel(
    low: Array, high: Array, most: int, items: Indices, work: Indices, nodes: Array
) -> int:
    """Write the nodes (2 m, 10) over boxes ``low``, ``high`` (m, 3); how many there are.

    ``items`` (m,) are sorted by leaf; ``work`` (m + 2 _DEEPEST,) is scratch.
    """
    m = items.shape[0]
    for k in range(m):
        items[k] = k
    spare, stack = work[:m], work[m:]
    stack[0], stack[1] = 0, m
    top, made = 2 if m > 0 else 0, 0
    while top > 0:
        top -= 2
        first, last = stack[top], stack[top + 1]
        node = made
        made += 1
        longest, length = 0, -1.0
        for axis in range(3):
            lowest, highest, least, largest = np.inf, -np.inf, np.inf, -np.inf
            for entry in range(first, last):
                k = items[entry]
                lowest, highest = min(lowest, low[k, axis]), max(highest, high[k, axis])
                middle = low[k, axis] + high[k, axis]
                least, largest = min(least, middle), max(largest, middle)
            nodes[node, BOX + axis], nodes[node, BOX + 3 + axis] = lowest, highest
            if largest - least > length:
                longest, length = axis, largest - least
        nodes[node, FIRST], nodes[node, LAST] = first, last
        if last - first <= most:
            continue
        _sort_by_middles(low, high, longest, items, spare, first, last)
        half = (first + last) // 2
        stack[top], stack[top + 1] = half, last
        stack[top + 2], stack[top + 3] = first, half
        top += 4
    # All that follow a node and lie in its span are below it.
    for node in range(made - 1, -1, -1):
        after = node + 1
        while after < made and nodes[after, FIRST] < nodes[node, LAST]:
            after = int(nodes[after, SKIP])
        nodes[node, SKIP] = after
    for node in range(made):
        square = 0.0
        for axis in range(3):
            square += (nodes[node, BOX + 3 + axis] - nodes[node, BOX + axis]) ** 2
        nodes[node, EXTENT] = 0.5 * np.sqrt(square)
        if nodes[node, LAST] - nodes[node, FIRST] > most:
            nodes[node, FIRST], nodes[node, LAST] = -1.0, -1.0
    return made


def tree(low: Array, high: Array, most: int = _LEAF) -> Tree:
    """The tree over boxes from ``low`` to ``high``, both (m, 3), at most so many in a leaf."""
    m = len(low)
    items, nodes = np.empty(m, dtype=np.int64), np.empty((2 * m, NODE_WIDTH))
    work = np.empty(m + 2 * _DEEPEST, dtype=np.int64)
    made = grow_kernel(
        np.ascontiguousarray(low), np.ascontiguousarray(high), most, items, work, nodes
    )
    nodes = nodes[:made].copy()
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
