"""A tree of boxes over what stands still, so that most of it is never visited.

Nodes lie in the order in which a walk meets them; a node that is far away is skipped together with
all below it by going on at its ``skips``. Halved at the median along the longest side:
"Real-time collision detection", chapter 6.
"""

from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from compiled.simd import Lanes
from kinematics.arrays import Array, Indices

#: Pieces in a leaf: a walk step costs about as much as a check of two of them.
LEAF = 2
#: Spans that wait while others are halved: one a level of a tree, which halves what it holds.
DEEPEST = 128
#: Records that are sorted sooner than they are parted.
_FEW = 12


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


@kernel(allocates=False, inline="always")
def _sort_few(middles: Array, items: Indices, first: int, last: int, axes: int) -> None:
    """Sort records first to last - 1 of middles and items in the order of ``axes``."""
    for entry in range(first + 1, last):
        x, y, z, item = middles[entry, 0], middles[entry, 1], middles[entry, 2], items[entry]
        at = entry
        while at > first and _is_before(x, y, z, item, middles, items, at - 1, axes):
            _move(middles, items, at - 1, at)
            at -= 1
        middles[at, 0], middles[at, 1], middles[at, 2], items[at] = x, y, z, item


@kernel(allocates=False, inline="code")
def _is_before(
    x: float, y: float, z: float, item: int, middles: Array, items: Indices, k: int, axes: int
) -> bool:
    """Whether a record comes before record k: by its first axis, where equal by the next, ..."""
    while axes > 0:
        axis = axes & 3
        own = x if axis == 1 else y if axis == 2 else z
        if own != middles[k, axis - 1]:
            return bool(own < middles[k, axis - 1])
        axes >>= 2
    return bool(item < items[k])


@kernel(allocates=False, inline="code")
def _move(middles: Array, items: Indices, source: int, target: int) -> None:
    """Copy a record."""
    for axis in range(3):
        middles[target, axis] = middles[source, axis]
    items[target] = items[source]


@kernel(allocates=False, inline="always")
def _part(
    middles: Array, items: Indices, span: tuple[int, int], half: int, axes: int, draw: int
) -> int:
    """Reorder the records of a span so that those that come first lie before ``half``.

    Records are parted about one of them until ``half`` is where it would be if all were sorted.

    Returns:
        The state of the generator that draws them, begun by ``draw``: no order of a mesh's
        triangles makes bad choices likely.
    """
    low, high = span[0], span[1] - 1
    while high - low >= _FEW:
        draw = (draw * 1103515245 + 12345) % 2147483648
        k = low + (draw >> 4) % (high - low + 1)
        x, y, z, item = middles[k, 0], middles[k, 1], middles[k, 2], items[k]
        i, j = low, high
        while i <= j:
            while item != items[i] and not _is_before(x, y, z, item, middles, items, i, axes):
                i += 1
            while _is_before(x, y, z, item, middles, items, j, axes):
                j -= 1
            if i <= j:
                a, b, c, other = middles[i, 0], middles[i, 1], middles[i, 2], items[i]
                _move(middles, items, j, i)
                middles[j, 0], middles[j, 1], middles[j, 2], items[j] = a, b, c, other
                i += 1
                j -= 1
        if half <= j:
            high = j
        elif half >= i:
            low = i
        else:
            return draw
    _sort_few(middles, items, low, high + 1, axes)
    return draw


@kernel(allocates=False, inline="always")
def _longest_axis(middles: Array, first: int, last: int) -> int:
    """Axis along which the middles of a span are spread most."""
    longest, length = 0, -1.0
    for axis in range(3):
        least, largest = np.inf, -np.inf
        for entry in range(first, last):
            middle = middles[entry, axis]
            least, largest = min(least, middle), max(largest, middle)
        if largest - least > length:
            longest, length = axis, largest - least
    return longest


@kernel(allocates=False, inline="always")
def _close(low: Array, high: Array, items: Indices, most: int, nodes: Array) -> None:
    """Write the boxes of nodes whose spans are known, their sizes and where each goes on."""
    made = nodes.shape[0]
    for node in range(made - 1, -1, -1):
        first, last = int(nodes[node, FIRST]), int(nodes[node, LAST])
        nodes[node, :3], nodes[node, 3:6] = np.inf, -np.inf
        after = node + 1
        if last - first <= most:
            for entry in range(first, last):
                k = items[entry]
                for axis in range(3):
                    nodes[node, axis] = min(nodes[node, axis], low[k, axis])
                    nodes[node, 3 + axis] = max(nodes[node, 3 + axis], high[k, axis])
        else:
            # The node next to it is its first half, and that after all below that one the other.
            for _ in range(2):
                for axis in range(3):
                    nodes[node, axis] = min(nodes[node, axis], nodes[after, axis])
                    nodes[node, 3 + axis] = max(nodes[node, 3 + axis], nodes[after, 3 + axis])
                after = int(nodes[after, SKIP])
            nodes[node, FIRST], nodes[node, LAST] = -1.0, -1.0
        nodes[node, SKIP] = after
        square = 0.0
        for axis in range(3):
            square += (nodes[node, BOX + 3 + axis] - nodes[node, BOX + axis]) ** 2
        nodes[node, EXTENT] = 0.5 * np.sqrt(square)


@kernel(allocates=False, unlocks=False)
def grow_kernel(
    low: Array, high: Array, most: int, items: Indices, middles: Array, nodes: Array
) -> int:
    """Write the nodes (2 m - 1, 10) over boxes ``low``, ``high`` (m, 3); how many there are.

    ``items`` (m,) are sorted by leaf; ``middles`` (m + DEEPEST, 3) is scratch.
    """
    m = items.shape[0]
    for k in range(m):
        items[k] = k
        for axis in range(3):
            middles[k, axis] = low[k, axis] + high[k, axis]
    # Spans that wait: where each begins and ends, and the order in which its items would stand.
    stack = middles[m:]
    stack[0, 0], stack[0, 1], stack[0, 2] = 0.0, float(m), 0.0
    top, made, draw = 1 if m > 0 else 0, 0, 1
    while top > 0:
        top -= 1
        first, last, axes = int(stack[top, 0]), int(stack[top, 1]), int(stack[top, 2])
        nodes[made, FIRST], nodes[made, LAST] = first, last
        made += 1
        if last - first <= most:
            _sort_few(middles, items, first, last, axes)
            continue
        # Records are compared by the longest axis first, and where equal as they were.
        longest = _longest_axis(middles, first, last) + 1
        before, axes, place = axes, longest, 2
        while before > 0:
            if before & 3 != longest:
                axes |= (before & 3) << place
                place += 2
            before >>= 2
        half = (first + last) // 2
        draw = _part(middles, items, (first, last), half, axes, draw)
        stack[top, 0], stack[top, 1], stack[top, 2] = half, last, axes
        stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = first, half, axes
        top += 2
    _close(low, high, items, most, nodes[:made])
    return made


def tree(low: Array, high: Array, most: int = LEAF) -> Tree:
    """The tree over boxes from ``low`` to ``high``, both (m, 3), at most so many in a leaf."""
    m = len(low)
    items, nodes = np.empty(m, dtype=np.int64), np.empty((max(2 * m - 1, 0), NODE_WIDTH))
    middles = np.empty((m + DEEPEST, 3))
    made = grow_kernel(
        np.ascontiguousarray(low), np.ascontiguousarray(high), most, items, middles, nodes
    )
    if made < len(nodes):
        nodes = nodes[:made].copy()
    for array in (nodes, items):
        array.setflags(write=False)
    return Tree(nodes, items)


@kernel(allocates=False, inline="code")
def gap(nodes: Array, node: int, x: Lanes, y: Lanes, z: Lanes) -> Lanes:
    """Square of the distance of a point from a node's box [m^2], of numbers or of vectors."""
    dx = max(nodes[node, 0] - x, x - nodes[node, 3])
    dy = max(nodes[node, 1] - y, y - nodes[node, 4])
    dz = max(nodes[node, 2] - z, z - nodes[node, 5])
    dx, dy, dz = max(dx, 0.0), max(dy, 0.0), max(dz, 0.0)
    square: Lanes = dx * dx + dy * dy + dz * dz
    return square
