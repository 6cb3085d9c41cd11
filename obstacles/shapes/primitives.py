"""Shape primitives side by side: boxes, balls, cylinders, cones and half-spaces by their measures.

A new scene is mostly made of them. One kernel packs all of them at once, which costs less than to
make a piece of each and to ask numpy for a row of each.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from obstacles.convex.piece import PieceArrays, PieceKind, bound_polytopes, cone_ball


class Primitive(IntEnum):
    """A solid with three measures at most [m]."""

    BOX = 0  # full edge lengths
    BALL = 1  # radius
    CYLINDER = 2  # radius, full height
    CONE = 3  # radius, full height
    HALFSPACE = 4  # none


_BOX, _BALL = int(Primitive.BOX), int(Primitive.BALL)
_CYLINDER, _CONE, _HALFSPACE = (
    int(Primitive.CYLINDER), int(Primitive.CONE), int(Primitive.HALFSPACE),
)  # fmt: skip
_PIECE_KINDS = np.array(
    [
        PieceKind.POLYTOPE, PieceKind.POLYTOPE, PieceKind.CYLINDER, PieceKind.CONE,
        PieceKind.HALFSPACE,
    ],
    dtype=np.int64,
)  # fmt: skip
_CORNER_COUNTS = np.array([8, 1, 0, 0, 0], dtype=np.int64)
for _table in (_PIECE_KINDS, _CORNER_COUNTS):
    _table.setflags(write=False)


class Primitives(NamedTuple):
    """Some primitives (k of them).

    Args:
        kinds: Kinds as ``Primitive``, shape (k,).
        measures: Shape (k, 3) [m].
        poses: T_world_primitive, shape (k, 4, 4); a half-space is z <= 0 of its frame.
    """

    kinds: Indices
    measures: Array
    poses: Array

    def part(self, first: int, last: int) -> "Primitives":
        """Rows from one number to before another."""
        chosen = slice(first, last)
        return Primitives(self.kinds[chosen], self.measures[chosen], self.poses[chosen])


def primitive_pieces(primitives: Primitives) -> PieceArrays:
    """The pieces that the primitives are, one each."""
    k, pieces = len(primitives.kinds), _PIECE_KINDS[primitives.kinds]
    counts = _CORNER_COUNTS[primitives.kinds]
    starts = np.zeros(k + 1, dtype=np.int64)
    counts.cumsum(out=starts[1:])
    vertices, sizes, centers = np.empty((starts[-1], 3)), np.zeros((k, 3)), np.empty((k, 3))
    radii, boxes = np.empty(k), np.zeros((k, 6))
    primitive_pieces_kernel(primitives, pieces, starts, vertices, sizes, centers, radii, boxes)
    return PieceArrays(pieces, starts, vertices, sizes, primitives.poses, centers, radii, boxes)


@kernel(unlocks=False)
def primitive_columns_kernel(
    primitives: Primitives,
) -> tuple[Indices, Indices, Array, Array, Array, Array, Array, Array]:
    """Columns of ``primitive_pieces``, in the order of ``PieceArrays``, for other kernels."""
    k = primitives.kinds.shape[0]
    pieces, starts = np.empty(k, np.int64), np.zeros(k + 1, np.int64)
    for i in range(k):
        kind = primitives.kinds[i]
        pieces[i], starts[i + 1] = _PIECE_KINDS[kind], starts[i] + _CORNER_COUNTS[kind]
    vertices, sizes, centers = np.empty((starts[k], 3)), np.zeros((k, 3)), np.empty((k, 3))
    radii, boxes = np.empty(k), np.zeros((k, 6))
    primitive_pieces_kernel(primitives, pieces, starts, vertices, sizes, centers, radii, boxes)
    return pieces, starts, vertices, sizes, primitives.poses, centers, radii, boxes


@kernel(allocates=False, unlocks=False)
def primitive_pieces_kernel(
    primitives: Primitives, pieces: Indices, starts: Indices, vertices: Array, sizes: Array,
    centers: Array, radii: Array, boxes: Array,
) -> None:  # fmt: skip
    """Write columns of ``primitive_pieces``; ``sizes`` and ``boxes`` hold zeros."""
    kinds, measures, poses = primitives.kinds, primitives.measures, primitives.poses
    for k in range(kinds.shape[0]):
        kind = kinds[k]
        if kind == _BOX:
            for corner in range(8):
                for axis in range(3):
                    half = 0.5 * measures[k, axis]
                    positive = (corner >> (2 - axis)) & 1
                    vertices[starts[k] + corner, axis] = half if positive else -half
        elif kind == _BALL:
            vertices[starts[k], :] = 0.0
            sizes[k, 2] = measures[k, 0]
        else:
            if kind != _HALFSPACE:
                sizes[k, 0], sizes[k, 1] = measures[k, 0], 0.5 * measures[k, 1]
            height, radii[k] = write_core(kind, measures[k], boxes[k])
            for row in range(3):
                centers[k, row] = poses[k, row, 2] * height + poses[k, row, 3]
    # From the corners themselves, as for any piece that has some.
    bound_polytopes(pieces, starts, vertices, sizes, poses, centers, radii, boxes)


@kernel(allocates=False, inline="code")
def write_core(kind: int, measures: Array, box: Array) -> tuple[float, float]:
    """Write half the sizes of the box (6,) that holds a primitive, in its frame.

    Args:
        kind: Kind as ``Primitive``.
        measures: Shape (3,) [m].
        box: Middle of the box, which is left alone, and half its sizes [m].

    Returns:
        Height of the middle of a ball that holds the primitive, up its axis, and its radius [m].
    """
    if kind == _HALFSPACE:
        box[3], box[4], box[5] = np.inf, np.inf, np.inf
        return 0.0, np.inf
    if kind == _BOX:
        farthest = 0.0
        for axis in range(3):
            box[3 + axis] = 0.5 * measures[axis]
            farthest += box[3 + axis] * box[3 + axis]
        return 0.0, np.sqrt(farthest)
    if kind == _BALL:
        box[3], box[4], box[5] = measures[0], measures[0], measures[0]
        return 0.0, measures[0]
    half = 0.5 * measures[1]
    box[3], box[4], box[5] = measures[0], measures[0], half
    if kind == _CYLINDER:
        return 0.0, np.hypot(measures[0], half)
    return cone_ball(measures[0], half)
