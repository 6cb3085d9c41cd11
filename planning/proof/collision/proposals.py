"""Proposed separating directions: the one seam between the proof and GJK.

GJK's kernel reads wide packed rows (``obstacles.distance.piece_set``). They are packed here, but
those of a scene of solids are packed once for all (``obstacles.distance.scene_set``). The kernel is
called here, for the direction between the nearest points of two elements. Nothing that comes back
is believed: a direction is checked by ``separating_direction``, and the distance only decides which
pairs are worth a closer look. A wrong row or a wrong direction costs time, never truth. No other
module of the proof imports the distance iteration or its rows.
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from kinematics.caches.bounded_cache import array_bytes, bounded_cache
from obstacles.convex.piece import Piece
from obstacles.distance.epa import contact
from obstacles.distance.gjk import STILL, separation
from obstacles.distance.piece_set import (
    CENTER,
    GROUP,
    GROUP_STOP,
    KIND,
    NODE,
    NODE_STOP,
    POSE,
    ROUNDING,
    START,
    STOP,
    WIDTH,
    CoreKind,
    Lists,
    Pair,
    PieceSet,
)
from obstacles.distance.scene_set import pack, scene_set, shaped_pieces
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene

#: The pieces of a robot or a scene, packed.
PackedPieces = PieceSet
#: Numbers of packed pieces; None for all.
Rows = frozenset[int] | None
#: Columns of the first node of a cover's tree, and of the one after its last.
FIRST_NODE = NODE
STOP_NODE = NODE_STOP

_POLYTOPE = int(CoreKind.POLYTOPE)
_BALL = int(CoreKind.POINT)


class ProposalRows(NamedTuple):
    """Elements as GJK reads them (r rows, e elements, v corners).

    Args:
        rows: Packed pieces of the robot, then of the scene, columns as in ``PieceSet``, (r, WIDTH).
        row: The row of each element, shape (e,).
        first: First of an element's three corners where it is a triangle, else -1, shape (e,).
        corners: Corners of all polytopes and triangles, each in its piece's frame, shape (v, 3)
            [m].
        tables: Support tables of polytopes with many corners.
    """

    rows: Array
    row: Indices
    first: Indices
    corners: Array
    tables: Lists


class Proposal(NamedTuple):
    """A direction, and what it is found in.

    Args:
        axis: Axis from one element towards another, shape (3,).
        rows: Rows of the two pieces, shape (2, WIDTH).
        simplex: GJK's own, shape (8, 3).
    """

    axis: Array
    rows: Array
    simplex: Array


def any_rows() -> ProposalRows:
    """Rows that stand for all of them where a kernel is looked up by its arguments' types."""
    none, numbers = PieceSet.of(()), np.zeros(1, dtype=np.int64)
    return ProposalRows(none.rows, numbers, numbers, none.corners, none.tables)


@kernel
def empty_proposal() -> Proposal:
    """Arrays to be filled."""
    return Proposal(np.empty(3), np.empty((2, WIDTH)), np.empty((8, 3)))


def packed_pieces(robot: RobotGeometry, scene: Scene, opened: Rows = None) -> PieceSet:
    """Pack the pieces of a robot, each in the frame of its joint, and behind them a scene's.

    Args:
        robot: The robot.
        scene: Scene around the robot.
        opened: Rows of covers whose triangles are packed too, None for all; others are solids.
    """
    p = len(robot.pieces)
    around = _scene_rows(scene, rows_from(opened, p))
    own = _robot_rows(robot, rows_before(opened, p)).behind(around)
    rows = np.concatenate([own.rows, around.rows])
    if len(around.surfaces):
        grouped = rows[p:, GROUP_STOP] > 0.0
        rows[p:, GROUP : GROUP_STOP + 1][grouped] += p
    return own._replace(rows=rows)


@bounded_cache(maxsize=64)
def _robot_rows(robot: RobotGeometry, opened: Rows) -> PieceSet:
    return PieceSet.of(_with_surfaces(robot.pieces, 0, opened))


def rows_before(opened: Rows, row: int) -> Rows:
    """Rows that come before a row."""
    return None if opened is None else frozenset(k for k in opened if k < row)


def rows_from(opened: Rows, row: int) -> Rows:
    """Rows from a row on, counted from it."""
    return None if opened is None else frozenset(k - row for k in opened if k >= row)


def _with_surfaces(pieces: Iterable[Piece], first: int, opened: Rows) -> list[Piece]:
    """Pieces, rows ``first`` and on, without the triangles under those that are not opened."""
    return [
        piece
        if piece.surface is None or opened is None or row in opened
        else replace(piece, surface=None)
        for row, piece in enumerate(pieces, first)
    ]


def _scene_rows(scene: Scene, opened: Rows) -> PieceSet:
    """A scene's pieces in the order of its obstacles, clouds as balls."""
    return _rows_with_meshes(scene, opened) if scene.has_meshes else scene_set(scene)


@bounded_cache(maxsize=16, weigh=array_bytes)
def _rows_with_meshes(scene: Scene, opened: Rows) -> PieceSet:
    shaped, row = [shaped_pieces(obstacle) for obstacle in scene.obstacles], 0
    if not any(piece.surface is not None for pieces in shaped for piece in pieces):
        return scene_set(scene)
    for at, obstacle in enumerate(scene.obstacles):
        shaped[at] = tuple(_with_surfaces(shaped[at], row, opened))
        row += obstacle.count
    return pack(scene, shaped)


@kernel(allocates=False, inline="code")
def propose(
    model: ProposalRows,
    i: int,
    j: int,
    poses: Array,
    centers: Array,
    most: float,
    proposal: Proposal,
) -> float:
    """Overwrite ``proposal.axis`` with a direction from element j to element i that may part them.

    Args:
        model: The elements.
        i: One element.
        j: The other.
        poses: Poses of all elements in the base frame, shape (e, 4, 4).
        centers: Centres of the elements' balls, shape (e, 3) [m].
        most: Distances beyond this need not be told exactly [m].
        proposal: Proposal whose axis is the direction to begin with.

    Returns:
        Approximate distance of the elements at most [m].
    """
    rows = proposal.rows
    _place_row(model, rows, 0, i, poses, centers)
    _place_row(model, rows, 1, j, poses, centers)
    _, _, upper = separation(
        Pair(rows, 0, rows, 1),
        model.corners,
        model.tables,
        -np.inf,
        most,
        STILL,
        proposal.axis,
        proposal.simplex,
    )
    return float(upper)


@kernel
def propose_deepest(
    model: ProposalRows, i: int, j: int, poses: Array, centers: Array, proposal: Proposal
) -> float:
    """Overwrite ``proposal.axis`` with the direction from element j to i that parts them the most.

    Args:
        model: The elements.
        i: One element.
        j: The other.
        poses: Poses of all elements in the base frame, shape (e, 4, 4).
        centers: Centres of the elements' balls, shape (e, 3) [m].
        proposal: Proposal whose axis is the direction to begin with.

    Returns:
        Approximate distance, negative by the depth where they overlap [m].
    """
    rows = proposal.rows
    _place_row(model, rows, 0, i, poses, centers)
    _place_row(model, rows, 1, j, poses, centers)
    distance, u, _ = contact(rows, 0, rows, 1, model.corners, model.tables, proposal.axis)
    proposal.axis[0], proposal.axis[1], proposal.axis[2] = u
    return float(distance)


@kernel(allocates=False, inline="code")
def _place_row(
    model: ProposalRows, rows: Array, k: int, i: int, poses: Array, centers: Array
) -> None:
    """Write element i, placed, as row k."""
    packed = model.row[i]
    for column in range(WIDTH):
        rows[k, column] = model.rows[packed, column]
    if model.first[i] >= 0:
        rows[k, KIND], rows[k, ROUNDING] = _POLYTOPE, 0.0
        rows[k, START], rows[k, STOP] = model.first[i], model.first[i] + 3
    for row in range(3):
        rows[k, CENTER + row] = centers[i, row]
        for column in range(4):
            rows[k, POSE + 4 * row + column] = poses[i, row, column]
        if rows[k, KIND] == _BALL:
            # Where its centre is: a point of a cloud lies off the cloud's frame.
            rows[k, POSE + 4 * row + 3] = centers[i, row]
