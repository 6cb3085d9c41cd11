"""Elements that the proof compares: pieces, triangles under covers, and the boxes that hold them.

Those of a robot, of a scene, and of the tree over the scene are made apart and joined at last.
"""

from typing import NamedTuple

import numpy as np

from compiled.kernel import directly, kernel
from kinematics.arrays import Array, Indices
from obstacles.convex.piece import PieceArrays, PieceKind
from obstacles.distance.bvh import FIRST, Tree, tree
from planning.proof.collision.box_tree import (
    CONTAINED,
    LEAVES_ONCE,
    WRONG_BOXES,
    boxes_of_nodes,
    boxes_of_nodes_kernel,
    check_nodes,
    check_nodes_kernel,
    extents,
    extents_kernel,
    hold_items,
    leaf_boxes_kernel,
    refuse_broken,
    solid_boxes_kernel,
)
from planning.proof.collision.proposals import FIRST_NODE, STOP_NODE, PackedPieces

#: The kind of an element that only holds others; the rest are of ``PieceKind``.
HOLDER = -1


class Elements(NamedTuple):
    """Some elements (e elements, v vertices).

    Columns are as in ``PairArrays``, but that vertices, and elements below others, are counted from
    the first of these; ``row`` and ``first`` are as in ``ProposalRows``.
    """

    joints: Indices
    kinds: Indices
    starts: Indices
    vertices: Array
    sizes: Array
    poses: Array
    centers: Array
    radii: Array
    boxes: Array
    extents: Array
    below: Indices
    kids: Indices
    parts: Indices
    row: Indices
    first: Indices
    margins: Array


def join(own: Elements, around: Elements, boxed: Elements) -> Elements:
    """Three kinds of elements one behind the other, their vertices as columns, shape (3, v)."""
    e = len(own.kinds) + len(around.kinds) + len(boxed.kinds)
    v = len(own.vertices) + len(around.vertices) + len(boxed.vertices)
    k = len(own.kids) + len(around.kids) + len(boxed.kids)
    joined = empty_elements(e, (3, v), k)
    directly(join_kernel, own, around, boxed, joined)
    return joined


def empty_elements(e: int, corners: tuple[int, int], kids: int) -> Elements:
    """Arrays to be filled with so many elements, corners and elements below others."""

    def numbers(count: int) -> Indices:
        return np.empty(count, dtype=np.int64)

    return Elements(
        joints=numbers(e),
        kinds=numbers(e),
        starts=numbers(e + 1),
        vertices=np.empty(corners),
        sizes=np.empty((e, 3)),
        poses=np.empty((e, 4, 4)),
        centers=np.empty((e, 3)),
        radii=np.empty(e),
        boxes=np.empty((e, 6)),
        extents=np.empty(e),
        below=numbers(e + 1),
        kids=numbers(kids),
        parts=numbers(e),
        row=numbers(e),
        first=numbers(e),
        margins=np.empty(e),
    )


@kernel(allocates=False, unlocks=False)
def join_kernel(own: Elements, around: Elements, boxed: Elements, joined: Elements) -> None:
    """Write ``join``."""
    joined.starts[0], joined.below[0] = 0, 0
    append(own, 0, joined)
    append(around, own.kinds.shape[0], joined)
    append(boxed, own.kinds.shape[0] + around.kinds.shape[0], joined)


@kernel(allocates=False)
def append(block: Elements, base: int, joined: Elements) -> None:
    """Write elements so that the first becomes number ``base``."""
    corner, kid = joined.starts[base], joined.below[base]
    for k in range(block.kinds.shape[0]):
        e = base + k
        joined.joints[e], joined.kinds[e] = block.joints[k], block.kinds[k]
        joined.starts[e + 1] = corner + block.starts[k + 1]
        joined.below[e + 1] = kid + block.below[k + 1]
        for row in range(4):
            for column in range(4):
                joined.poses[e, row, column] = block.poses[k, row, column]
        for axis in range(3):
            joined.sizes[e, axis] = block.sizes[k, axis]
            joined.centers[e, axis] = block.centers[k, axis]
        for axis in range(6):
            joined.boxes[e, axis] = block.boxes[k, axis]
        joined.radii[e], joined.extents[e] = block.radii[k], block.extents[k]
        joined.parts[e], joined.margins[e] = block.parts[k], block.margins[k]
        joined.row[e], joined.first[e] = block.row[k], block.first[k]
    for v in range(block.vertices.shape[0]):
        for axis in range(3):
            joined.vertices[axis, corner + v] = block.vertices[v, axis]
    for k in range(block.kids.shape[0]):
        joined.kids[kid + k] = block.kids[k]


def solids(
    arrays: PieceArrays, packed: PackedPieces, rows: slice, nodes: slice, base: int
) -> Elements:
    """Pieces, and behind them what covers among them cover.

    Joints, parts and margins are left to the caller.

    Args:
        arrays: The pieces, p of them.
        packed: The same pieces packed for GJK, among others.
        rows: Rows of the elements in ``packed``.
        nodes: Nodes of their trees in it.
        base: The number that the first one gets.
    """
    p, own = len(arrays), packed.rows[rows]
    none, numbers = np.zeros(p, dtype=np.int64), np.arange(len(packed.rows), dtype=np.int64)[rows]
    far = extents(arrays.boxes, arrays.poses, arrays.sizes)
    tree_nodes, still = packed.surfaces[nodes], none - 1
    if not len(tree_nodes):
        return Elements(
            still, arrays.kinds, arrays.starts, arrays.vertices, arrays.sizes, arrays.poses,
            arrays.centers, arrays.radii, arrays.boxes, far, np.zeros(p + 1, dtype=np.int64),
            none[:0], none, numbers, still, none.astype(np.float64),
        )  # fmt: skip
    covers = own[:, STOP_NODE] > 0.0
    first_node = nodes.start or 0
    tops = own[covers, FIRST_NODE].astype(np.int64) - first_node
    spans = (own[covers, STOP_NODE] - own[covers, FIRST_NODE]).astype(np.int64)
    owner = np.repeat(np.flatnonzero(covers), spans)
    leaf = tree_nodes[:, FIRST] >= 0.0
    first = np.where(leaf, tree_nodes[:, FIRST], -1.0).astype(np.int64)
    corners = packed.corners[(first[leaf, None] + np.arange(3)).reshape(-1)]
    triangles = corners.reshape(-1, 3, 3)
    of_leaves = np.empty((len(leaf), 6))
    of_leaves[leaf] = np.hstack([triangles.min(axis=1), triangles.max(axis=1)])
    tree_nodes, children = check_nodes(tree_nodes, first_node, tops, of_leaves)
    boxes, poses = boxes_of_nodes(tree_nodes), arrays.poses[owner]
    centers = (poses[:, :3, :3] @ boxes[:, :3, None])[..., 0] + poses[:, :3, 3]
    t = len(leaf)
    sizes = np.zeros((t, 3))
    kinds = np.where(leaf, int(PieceKind.POLYTOPE), HOLDER)
    counts = np.concatenate([np.diff(arrays.starts), np.where(leaf, 3, 0)])
    kid_counts = np.concatenate([covers, np.where(leaf, 0, 2)])
    return Elements(
        joints=np.full(p + t, -1, dtype=np.int64),
        kinds=np.concatenate([arrays.kinds, kinds]),
        starts=_starts(counts),
        vertices=np.concatenate([arrays.vertices, corners]),
        sizes=np.concatenate([arrays.sizes, sizes]),
        poses=np.concatenate([arrays.poses, poses]),
        centers=np.concatenate([arrays.centers, centers]),
        radii=np.concatenate([arrays.radii, np.linalg.norm(boxes[:, 3:], axis=1)]),
        boxes=np.concatenate([arrays.boxes, boxes]),
        extents=np.concatenate([far, extents(boxes, poses, sizes)]),
        below=_starts(kid_counts),
        kids=np.concatenate([tops, children]) + (base + p),
        parts=np.zeros(p + t, dtype=np.int64),
        row=np.concatenate([numbers, numbers[owner]]),
        first=np.concatenate([still, first]),
        margins=np.zeros(p + t),
    )


def _starts(counts: Indices) -> Indices:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


class SolidBoxes(NamedTuple):
    """Pieces of a scene that a tree is grown over (m of them, of p).

    Args:
        numbers: Numbers of the pieces, shape (m,).
        low: Lowest corners of the pieces, shape (m, 3) [m].
        high: Highest corners of the pieces, shape (m, 3) [m].
        margins: Margins of all of the scene's pieces, shape (p,) [m].
    """

    numbers: Indices
    low: Array
    high: Array
    margins: Array


class Scratch(NamedTuple):
    """Workspace of ``hold_kernel``: boxes (t, 6), and zeros (1 + 2 m + 3 t)."""

    boxes: Array
    zeros: Indices

    @classmethod
    def of(cls, m: int, t: int) -> "Scratch":
        """For m solids and t nodes."""
        return cls(np.empty((t, 6)), np.zeros(1 + 2 * m + 3 * t, dtype=np.int64))


def boxes_over(arrays: PieceArrays, margins: Array, first: int, base: int) -> Elements:
    """A tree over a scene's pieces but half-spaces.

    Args:
        arrays: The pieces.
        margins: Margins of the pieces [m].
        first: The number of the first piece.
        base: The number that the tree's top gets.

    Raises:
        BrokenTree: The tree lacks a piece or holds one twice.
    """
    p = len(arrays)
    numbers, low, high = np.empty(p, dtype=np.int64), np.empty((p, 3)), np.empty((p, 3))
    m = solid_boxes_kernel(arrays.kinds, arrays.poses, arrays.boxes, numbers, low, high)
    solids = SolidBoxes(numbers[:m], low[:m], high[:m], margins)
    grown = tree(solids.low, solids.high)
    t = len(grown.nodes)
    boxed = empty_elements(t, (0, 3), max(m + t - 1, 0))
    refuse_broken(directly(hold_kernel, grown, solids, first, base, Scratch.of(m, t), boxed))
    return boxed


@kernel(allocates=False, unlocks=False)
def hold_kernel(
    grown: Tree, solids: SolidBoxes, first: int, base: int, scratch: Scratch, boxed: Elements
) -> int:
    """Write ``boxes_over`` from a tree that is checked before; what was found of it."""
    nodes, m, t = grown.nodes, solids.numbers.shape[0], grown.nodes.shape[0]
    # The first node is the top, which hangs below no other.
    top, zeros = scratch.zeros[:1], scratch.zeros[1:]
    seen, items, hung, children = zeros[:m], zeros[m : 2 * m], zeros[2 * m :], zeros[2 * m + t :]
    found = leaf_boxes_kernel(nodes, grown.items, solids.low, solids.high, seen, scratch.boxes)
    if found != LEAVES_ONCE:
        return found
    if t == 0:
        boxed.below[0] = 0
        return CONTAINED
    found, count = check_nodes_kernel(nodes, 0, top, hung, scratch.boxes, children)
    if found == WRONG_BOXES:
        boxes_of_nodes_kernel(scratch.boxes, boxed.boxes)
    elif found == CONTAINED:
        boxes_of_nodes_kernel(nodes, boxed.boxes)
    else:
        return found
    for entry in range(m):
        items[entry] = solids.numbers[grown.items[entry]]
    hold_items(
        nodes, items, children[:count], solids.margins, boxed.below, boxed.kids, boxed.margins
    )
    for kid in range(boxed.kids.shape[0]):
        held = boxed.kids[kid]
        boxed.kids[kid] = first + held if held >= 0 else base - 1 - held
    for k in range(t):
        square = 0.0
        for axis in range(3):
            boxed.sizes[k, axis], boxed.centers[k, axis] = 0.0, boxed.boxes[k, axis]
            square += boxed.boxes[k, 3 + axis] ** 2
        boxed.radii[k] = np.sqrt(square)
        for row in range(4):
            for column in range(4):
                boxed.poses[k, row, column] = 1.0 if row == column else 0.0
        boxed.joints[k], boxed.kinds[k], boxed.starts[k] = -1, HOLDER, 0
        boxed.parts[k], boxed.row[k], boxed.first[k] = -1, 0, -1
    boxed.starts[t] = 0
    extents_kernel(boxed.boxes, boxed.poses, boxed.sizes, boxed.extents)
    return found
