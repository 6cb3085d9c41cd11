"""Triangles and corners of convex pieces, for pages that draw them and for files of meshes."""

from collections.abc import Iterable
from functools import cache
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, Indices
from obstacles.convex.piece import Piece, PieceKind, convex_hull

#: Corners of a drawn circle.
_CIRCLE = 32
#: Corners of a drawn ball: a row for each of these polar angles, and the poles.
_RINGS = 7
#: Balls of a point cloud are drawn with so many corners in their place, as octahedra.
_OCTAHEDRON = np.vstack([np.eye(3), -np.eye(3)])
#: A half-space is drawn as a square of this side [m].
_GROUND = 4.0


class Triangles(NamedTuple):
    """A surface as triangles.

    Args:
        vertices: Shape (k, 3) [m].
        faces: Corners of each triangle, counter-clockwise from outside, shape (f, 3).
    """

    vertices: Array
    faces: Indices


def piece_triangles(piece: Piece, *, covers: bool = False, coarse: bool = False) -> Triangles:
    """The surface of a piece in the frame of what owns it.

    Args:
        piece: The piece.
        covers: Whether a part of a mesh is drawn as the hull that covers it.
        coarse: Whether balls are drawn as octahedra.
    """
    if piece.surface is not None and not covers:
        faces = piece.surface.triangles
        local = Triangles(faces.reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3))
    elif piece.kind == PieceKind.HALFSPACE:
        half = 0.5 * _GROUND
        square = [[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]]
        local = Triangles(np.array(square, dtype=float), np.array([[0, 1, 2], [0, 2, 3]]))
    else:
        hull = convex_hull(corners(piece, coarse=coarse))
        local = Triangles(hull.vertices, hull.triangles)
    T = piece.T_owner_piece
    return Triangles(local.vertices @ T[:3, :3].T + T[:3, 3], local.faces)


def join(parts: Iterable[Triangles]) -> Triangles:
    """Surfaces as one, each vertex once."""
    vertices, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], 0
    for part in parts:
        vertices.append(part.vertices)
        faces.append(part.faces + count)
        count += len(part.vertices)
    # In the precision of the page: corners that fall together are one.
    rounded = np.vstack(vertices).astype(np.float32)
    unique, numbers = np.unique(rounded, axis=0, return_inverse=True)
    return Triangles(unique.astype(np.float64), numbers.reshape(-1)[np.vstack(faces)])


def corners(piece: Piece, *, coarse: bool = False, around: bool = False) -> Array:
    """Points whose hull is the piece, or nearly so where it is round, in the piece's frame.

    Args:
        piece: Any but a half-space.
        coarse: Whether balls are octahedra.
        around: Whether the hull holds the whole piece; else its corners lie on the piece.

    Returns:
        Shape (k, 3) [m].
    """
    core = piece.vertices
    if piece.kind != PieceKind.POLYTOPE:
        angles = np.linspace(0.0, 2.0 * np.pi, _CIRCLE, endpoint=False)
        circle = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(_CIRCLE)])
        radius = piece.radius / np.cos(np.pi / _CIRCLE) if around else piece.radius
        height = np.array([0.0, 0.0, piece.half_height])
        top = radius * circle if piece.kind == PieceKind.CYLINDER else np.zeros((1, 3))
        core = np.vstack([radius * circle - height, top + height])
    if piece.offset_radius <= 0.0:
        return core
    ball = _OCTAHEDRON if coarse else _ball()
    scale = piece.offset_radius / (_inner_radius(coarse) if around else 1.0)
    return np.asarray((core[:, None] + scale * ball).reshape(-1, 3))


@cache
def _inner_radius(coarse: bool) -> float:
    """Radius of the ball inside of the hull of a drawn unit ball."""
    return float(convex_hull(_OCTAHEDRON if coarse else _ball()).planes[:, 3].min())


def _ball() -> Array:
    """Points of the unit sphere, the poles among them."""
    polar = np.linspace(0.0, np.pi, _RINGS + 2)[1:-1, None]
    around = np.linspace(0.0, 2.0 * np.pi, _CIRCLE // 2, endpoint=False)
    rows = [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around)]
    z = np.broadcast_to(np.cos(polar), rows[0].shape)
    points = np.stack([*rows, z], axis=-1).reshape(-1, 3)
    return np.vstack([points, [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
