"""Elements of a robot among pieces that stand still, packed by one kernel.

Most scenes that were never seen hold no mesh: nothing of theirs is below a cover, and a call for
each step of packing them would cost more than the step.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from compiled.kernel import direct, kernel
from kinematics.arrays import Array, Indices
from obstacles.convex.piece import PieceArrays
from obstacles.distance.bvh import DEEPEST, LEAF, NODE_WIDTH, Tree, grow_kernel
from obstacles.shapes.primitives import Primitives, primitive_columns_kernel
from planning.proof.collision.box_tree import (
    CONTAINED,
    WRONG_BOXES,
    refuse_broken,
)
from planning.proof.collision.element_boxes import extents_kernel, solid_boxes_kernel
from planning.proof.collision.elements import (
    Elements,
    Scratch,
    SolidBoxes,
    append,
    empty_elements,
    hold_kernel,
)


class PieceColumns(NamedTuple):
    """The columns of ``PieceArrays``, for kernels."""

    kinds: Indices
    starts: Indices
    vertices: Array
    sizes: Array
    poses: Array
    centers: Array
    radii: Array
    boxes: Array

    @classmethod
    def of(cls, arrays: PieceArrays) -> "PieceColumns":
        """Rows of some pieces."""
        return cls(*[getattr(arrays, name) for name in cls._fields])


def join_pieces(
    own: Elements, arrays: PieceArrays, owners: Indices, margins: Array, row: int
) -> tuple[Elements, int]:
    """``join`` of a robot's elements with a scene's pieces, none a cover, and the tree over them.

    Args:
        own: The robot's.
        arrays: The scene's pieces.
        owners: The obstacle that each belongs to, shape (p,).
        margins: Margins of the scene's pieces, shape (p,) [m].
        row: First row in what is packed for GJK.

    Returns:
        The elements, and how many of them are nodes of the tree.

    Raises:
        BrokenTree: The tree lacks a piece or holds one twice.
    """
    pieces = PieceColumns.of(arrays)
    joined, found, nodes = _join_pieces()(own, pieces, owners, margins, row)
    refuse_broken(found)
    return joined, nodes


def join_primitives(
    own: Elements, primitives: Primitives, margins: Array, row: int
) -> tuple[Elements, int]:
    """``join_pieces`` of a scene's primitives, each an obstacle of its own.

    Args:
        own: The robot's.
        primitives: The obstacles.
        margins: Margins of the scene's pieces [m].
        row: Row as in ``join_pieces``.
    """
    joined, found, nodes = _join_primitives()(own, primitives, margins, row)
    refuse_broken(found)
    return joined, nodes


@cache
def _join_pieces() -> Any:
    """``join_pieces_kernel`` without the look at its arguments' types."""
    none, owners = PieceColumns.of(PieceArrays.pack(())), np.zeros(0, dtype=np.int64)
    return direct(join_pieces_kernel, empty_elements(0, (0, 3), 0), none, owners, np.zeros(0), 0)


@cache
def _join_primitives() -> Any:
    """``join_primitives_kernel`` likewise."""
    none = Primitives(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 4, 4)))
    return direct(join_primitives_kernel, empty_elements(0, (0, 3), 0), none, np.zeros(0), 0)


@kernel(unlocks=False)
def join_primitives_kernel(
    own: Elements, primitives: Primitives, margins: Array, row: int
) -> tuple[Elements, int, int]:
    """``join_pieces_kernel`` of primitives."""
    pieces = PieceColumns(*primitive_columns_kernel(primitives))
    owners = np.arange(0, margins.shape[0])
    return join_pieces_kernel(own, pieces, owners, margins, row)


@kernel(unlocks=False)
def join_pieces_kernel(
    own: Elements, pieces: PieceColumns, owners: Indices, margins: Array, row: int
) -> tuple[Elements, int, int]:
    """Elements of ``join_pieces``, what was found of the tree, and how many nodes it has."""
    base, p = own.kinds.shape[0], pieces.kinds.shape[0]
    around = _as_elements(pieces, owners, margins, row)
    numbers, low, high = np.empty(p, np.int64), np.empty((p, 3)), np.empty((p, 3))
    m = solid_boxes_kernel(pieces.kinds, pieces.poses, pieces.boxes, numbers, low, high)
    solids = SolidBoxes(numbers[:m], low[:m], high[:m], margins)
    items, middles = np.empty(m, np.int64), np.empty((m + DEEPEST, 3))
    nodes = np.empty((max(2 * m - 1, 0), NODE_WIDTH))
    t = grow_kernel(solids.low, solids.high, LEAF, items, middles, nodes)
    scratch = Scratch(np.empty((t, 6)), np.zeros(1 + 2 * m + 3 * t, np.int64))
    boxed = _rows_of_elements(t, 0, max(m + t - 1, 0))
    found = hold_kernel(Tree(nodes[:t], items), solids, base, base + p, scratch, boxed)
    corners = own.vertices.shape[0] + pieces.vertices.shape[0]
    joined = _columns_of_elements(base + p + t, corners, own.kids.shape[0] + max(m + t - 1, 0))
    joined.starts[0], joined.below[0] = 0, 0
    append(own, 0, joined)
    append(around, base, joined)
    if found in (CONTAINED, WRONG_BOXES):
        append(boxed, base + p, joined)
    return joined, found, t


@kernel
def _as_elements(pieces: PieceColumns, owners: Indices, margins: Array, row: int) -> Elements:
    """``solids`` of pieces that cover nothing and stand still."""
    p = pieces.kinds.shape[0]
    none, far = np.zeros(p + 1, np.int64), np.empty(p)
    still = np.full(p, -1, np.int64)
    extents_kernel(pieces.boxes, pieces.poses, pieces.sizes, far)
    return Elements(
        still, pieces.kinds, pieces.starts, pieces.vertices, pieces.sizes, pieces.poses,
        pieces.centers, pieces.radii, pieces.boxes, far, none, none[:0], owners,
        np.arange(row, row + p), still, margins,
    )  # fmt: skip


@kernel
def _rows_of_elements(e: int, corners: int, kids: int) -> Elements:
    """``empty_elements`` of elements whose corners lie in rows."""
    return _elements(e, np.empty((corners, 3)), kids)


@kernel
def _columns_of_elements(e: int, corners: int, kids: int) -> Elements:
    """``empty_elements`` of elements whose corners lie in columns."""
    return _elements(e, np.empty((3, corners)), kids)


@kernel
def _elements(e: int, vertices: Array, kids: int) -> Elements:
    return Elements(
        np.empty(e, np.int64), np.empty(e, np.int64), np.empty(e + 1, np.int64), vertices,
        np.empty((e, 3)), np.empty((e, 4, 4)), np.empty((e, 3)), np.empty(e), np.empty((e, 6)),
        np.empty(e), np.empty(e + 1, np.int64), np.empty(kids, np.int64), np.empty(e, np.int64),
        np.empty(e, np.int64), np.empty(e, np.int64), np.empty(e),
    )  # fmt: skip
