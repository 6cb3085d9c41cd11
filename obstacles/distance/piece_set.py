"""Convex pieces packed for the kernels that compare them: one row of numbers each.

Kernels are handed few arrays with wide rows rather than many narrow ones: every array handed from
one kernel to another costs about as much as a distance of two balls.

A hull of many corners has a support table, a short list of corners for each cell of directions, cut
from the faces of a cube. Over the cell of directions (1, u, v) with u and v in intervals, how much
farther one corner reaches than another is affine in u and v, so a corner that another one beats at
the four ends of the cell is never the farthest in it. The farthest corner in the list is the
farthest of all: nothing is guessed, unlike walking from corner to corner, which may stop on a face
that is not quite flat.
"""

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array
from kinematics.caches.bounded_cache import array_bytes, bounded_cache
from kinematics.caches.preparation_limit import check_preparation_time
from obstacles.convex.piece import Piece, PieceKind, core_of
from obstacles.distance.bvh import FIRST, LAST, NODE_WIDTH, SKIP, tree

#: Of three numbers.
_CORNER_BYTES = 24
#: What stands in which columns of a row: its kind, the obstacle it belongs to and that obstacle's
#: margin; a ball that holds it, in the owner's frame; of a box half sizes, else radius and half
#: height, then the rounding; a box that holds it by its middle and half sizes, in its own frame;
#: the upper three rows of T_owner_piece; its corners, from one to before the other; its table.
KIND, OWNER, MARGIN = 0, 1, 2
CENTER, RADIUS = 3, 6
SIZE, ROUNDING = 7, 10
MIDDLE, HALF = 11, 14
POSE = 17
START, STOP, TABLE = 29, 30, 31
#: Of a cover: the nodes of a tree over its triangles, the rows that bound a solid together with it,
#: and corners that lie one on each of its bodies. From one to before the other; 0, 0 for none.
NODE, NODE_STOP = 32, 33
GROUP, GROUP_STOP = 34, 35
ANCHOR, ANCHOR_STOP = 36, 37
WIDTH = 38
#: A support table, or several.
Lists = NDArray[np.int32]
#: Cells along an edge of the cube: lists of three to six corners for hulls of a hundred.
SIDE = 8
CELLS = 6 * SIDE * SIDE
#: Fewer corners than this are looked through as fast as a list is found.
LEAST_CORNERS = 13
#: Corners within this [m] of each other in reach are both kept: rounding must not choose.
_TIE = 1e-12


class CoreKind(IntEnum):
    """How the farthest point of a core is found."""

    POLYTOPE = 0
    CYLINDER = 1
    CONE = 2
    HALFSPACE = 3
    BOX = 4
    TABLED = 5
    POINT = 6


#: As numbers: to look a member of an enumeration up takes longer than the rest of a row.
_TABLED = float(CoreKind.TABLED)
_CORNERED = float(CoreKind.POLYTOPE), _TABLED


class Pair(NamedTuple):
    """Two pieces, their poses in a common frame.

    Args:
        a: Rows of a ``PieceSet``, shape (p, WIDTH).
        i: The row of the first piece.
        b: Rows of a ``PieceSet``, the same or others, shape (q, WIDTH).
        j: The row of the second piece.
    """

    a: Array
    i: int
    b: Array
    j: int


class Shapes(NamedTuple):
    """Arrays of a ``PieceSet`` that its rows refer to.

    Args:
        corners: Corners of polytopes and triangles, shape (v, 3) [m].
        tables: Support tables.
        nodes: Trees over the triangles of covers, shape (t, NODE_WIDTH).
    """

    corners: Array
    tables: Lists
    nodes: Array


class PieceSet(NamedTuple):
    """Pieces side by side (p pieces, v corners).

    Args:
        rows: One for each piece, columns as named above, shape (p, WIDTH).
        corners: Corners in the frame of the piece they belong to, shape (v, 3).
        tables: Tables of tabled pieces one behind the other.
        surfaces: Nodes of the trees over the triangles of covers, one triangle a leaf, columns as
            in ``Tree`` but that a leaf goes from one to before another corner; shape (t, 10).
    """

    rows: Array
    corners: Array
    tables: Lists
    surfaces: Array

    @classmethod
    def of(cls, pieces: Sequence[Piece]) -> "PieceSet":
        """Pack pieces in their order."""
        rows = _rows(pieces)
        kinds = rows[:, KIND].tolist()
        corners, tables = [np.zeros((0, 3))], [np.zeros(0, dtype=np.int32)]
        surfaces, shifts = [np.zeros((0, NODE_WIDTH))], list[tuple[int, int]]()
        corner, cell, node = 0, 0, 0
        for i, (kind, piece) in enumerate(zip(kinds, pieces, strict=True)):
            if kind not in _CORNERED and piece.surface is None:
                continue
            row = rows[i]
            if kind in _CORNERED:
                row[START], row[STOP] = corner, corner + len(piece.vertices)
                corner += len(piece.vertices)
                corners.append(piece.vertices)
            if kind == _TABLED:
                row[TABLE] = cell
                tables.append(_table(piece.vertices.tobytes()))
                cell += len(tables[-1])
            if piece.surface is not None:
                check_preparation_time()
                own, triangles = _surface_tree(piece.surface.triangles.tobytes())
                surfaces.append(own)
                shifts.append((node, corner))
                row[NODE], row[NODE_STOP] = node, node + len(own)
                row[ANCHOR] = corner + len(triangles)
                corners += [triangles, piece.surface.anchors]
                corner += len(triangles) + len(piece.surface.anchors)
                row[ANCHOR_STOP] = corner
                if piece.surface.count:
                    row[GROUP] = i - piece.surface.place
                    row[GROUP_STOP] = row[GROUP] + piece.surface.count
                node += len(own)
        packed, nodes = np.ascontiguousarray(np.vstack(corners)), np.vstack(surfaces)
        for (first, before), own in zip(shifts, surfaces[1:], strict=True):
            _shift(nodes[first : first + len(own)], first, before)
        return cls(rows, packed, np.concatenate(tables), nodes)

    def behind(self, other: "PieceSet") -> "PieceSet":
        """Pieces with the corners and tables of ``other`` before theirs."""
        if not len(other.corners):
            return self
        rows = self.rows.copy()
        rows[:, START : STOP + 1] += len(other.corners)
        rows[:, TABLE] += len(other.tables)
        covers = rows[:, NODE_STOP] > 0.0
        rows[covers, NODE : NODE_STOP + 1] += len(other.surfaces)
        rows[covers, ANCHOR : ANCHOR_STOP + 1] += len(other.corners)
        surfaces = self.surfaces.copy()
        _shift(surfaces, len(other.surfaces), len(other.corners))
        return PieceSet(
            rows,
            np.vstack([other.corners, self.corners]),
            np.concatenate([other.tables, self.tables]),
            np.vstack([other.surfaces, surfaces]),
        )


def ball_rows(points: Array, radius: float) -> Array:
    """Rows (b, WIDTH) of balls about ``points`` (b, 3)."""
    rows = np.zeros((len(points), WIDTH))
    rows[:, KIND] = CoreKind.POINT
    rows[:, CENTER : CENTER + 3] = points
    rows[:, RADIUS] = rows[:, ROUNDING] = radius
    rows[:, HALF : HALF + 3] = radius
    rows[:, POSE : POSE + 12] = np.eye(4)[:3].reshape(12)
    rows[:, POSE + 3 : POSE + 12 : 4] = points
    return rows


def _rows(pieces: Sequence[Piece]) -> Array:
    """The rows of pieces but for what they share, all placed at once, shape (p, WIDTH)."""
    own = [
        _row(int(p.kind), p.vertices.tobytes(), p.radius, p.half_height, p.offset_radius)
        for p in pieces
    ]
    rows = np.array(own).reshape(-1, WIDTH)
    T = np.array([p.T_owner_piece[:3] for p in pieces]).reshape(-1, 3, 4)
    centers = rows[:, CENTER : CENTER + 3, None]
    centers[:] = T[:, :, :3] @ centers + T[:, :, 3:]
    points = rows[:, KIND] == CoreKind.POINT
    T[points, :, :3], T[points, :, 3:] = np.eye(3), centers[points]
    rows[:, POSE : POSE + 12] = T.reshape(-1, 12)
    return rows


#: Obstacles that only move from request to request keep all else of their rows.
@bounded_cache(maxsize=4096, weigh=array_bytes)
def _row(kind: int, corners: bytes, radius: float, half_height: float, rounding: float) -> Array:
    """The row of a piece in its own frame, shape (WIDTH,)."""
    count, row = len(corners) // _CORNER_BYTES, np.zeros(WIDTH)
    core = core_of(kind, corners, radius, half_height)
    row[KIND] = kind
    if core.half is not None and rounding == 0.0:
        row[KIND], row[SIZE : SIZE + 3] = CoreKind.BOX, core.half
    elif count == 1:
        row[KIND] = CoreKind.POINT
    elif kind == PieceKind.POLYTOPE and count >= LEAST_CORNERS:
        row[KIND] = CoreKind.TABLED
    else:
        row[SIZE], row[SIZE + 1] = radius, half_height
    row[ROUNDING] = rounding
    row[CENTER : CENTER + 3], row[RADIUS] = core.center, core.radius + rounding
    row[MIDDLE : MIDDLE + 6] = core.box
    row[HALF : HALF + 3] += rounding
    if count == 1:
        row[MIDDLE : MIDDLE + 3] = 0.0  # its frame is put at its point
    row.setflags(write=False)
    return row


@bounded_cache(maxsize=1024, weigh=array_bytes)
def _surface_tree(triangles: bytes) -> tuple[Array, Array]:
    """The tree over a cover's triangles, and their corners in its leaves' order."""
    corners = np.frombuffer(triangles).reshape(-1, 3, 3)
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    grown = tree(np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c), 1)
    nodes = grown.nodes.copy()
    leaves = nodes[:, FIRST] >= 0.0
    nodes[leaves, FIRST : LAST + 1] *= 3.0
    nodes.setflags(write=False)
    return nodes, corners[grown.items].reshape(-1, 3)


def _shift(nodes: Array, by: int, corners: int) -> None:
    """Renumber nodes that come to stand behind others, in place."""
    leaves = nodes[:, FIRST : FIRST + 1] >= 0.0
    nodes[:, SKIP] += by
    np.add(nodes[:, FIRST : LAST + 1], corners, out=nodes[:, FIRST : LAST + 1], where=leaves)


@bounded_cache(maxsize=1024)
def _table(corners: bytes) -> Lists:
    return support_table(np.frombuffer(corners).reshape(-1, 3))


@kernel(allocates=False, inline="always")
def cell_of(x: float, y: float, z: float) -> int:
    """The cell that a direction lies in; 0 for a direction of no length."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        major, u, v, face = ax, y, z, (0 if x >= 0.0 else 1)
    elif ay >= az:
        major, u, v, face = ay, z, x, (2 if y >= 0.0 else 3)
    else:
        major, u, v, face = az, x, y, (4 if z >= 0.0 else 5)
    if not major > 0.0:
        return 0
    scale = 0.5 * SIDE / major
    column = min(int(u * scale + 0.5 * SIDE), SIDE - 1)
    row = min(int(v * scale + 0.5 * SIDE), SIDE - 1)
    return (face * SIDE + row) * SIDE + column


def _cell_corners() -> Array:
    """Directions to the four corners of each cell, a hair beyond its rim, shape (CELLS, 4, 3)."""
    cell, end = np.arange(CELLS)[:, None], np.arange(4)
    face, row, column = cell // (SIDE * SIDE), cell // SIDE % SIDE, cell % SIDE
    u = 2.0 * (column + end % 2) / SIDE - 1.0 + np.where(end % 2, 1e-9, -1e-9)
    v = 2.0 * (row + end // 2) / SIDE - 1.0 + np.where(end // 2, 1e-9, -1e-9)
    sign = np.broadcast_to(np.where(face % 2, -1.0, 1.0), u.shape)
    turned = np.select(
        [(face < 2)[..., None], (face < 4)[..., None]],
        [np.stack([sign, u, v], axis=-1), np.stack([v, sign, u], axis=-1)],
        np.stack([u, v, sign], axis=-1),
    )
    return np.ascontiguousarray(turned)


_CELL_CORNERS = _cell_corners()


def support_table(corners: Array) -> Lists:
    """Table of a hull's corners (k, 3): where the list of each cell starts, then the lists."""
    reach = _CELL_CORNERS @ corners.T
    rivals = np.column_stack([reach.argmax(axis=2), reach.sum(axis=1).argmax(axis=1)])
    kept = np.ones((CELLS, len(corners)), dtype=np.bool_)
    for rival in rivals.T:
        best = np.take_along_axis(reach, rival[:, None, None], axis=2)
        kept &= ~(best > reach + _TIE).all(axis=1)
    starts = CELLS + 1 + np.concatenate([[0], np.cumsum(kept.sum(axis=1))])
    return np.concatenate([starts, np.nonzero(kept)[1]]).astype(np.int32)
