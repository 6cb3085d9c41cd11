"""Convex pieces as solids of FCL, and its distance query: the only user of fcl.

FCL stops iterating at steps of a fixed 1e-6 units, so it is given every solid in units of ten
micrometres. It knows no points and no segments: they are balls and capsules as thin as ``THIN``.
Its signed query, which would answer penetrations, is never asked: where solids only touch, it does
not return.
"""

from dataclasses import dataclass
from typing import NamedTuple

import fcl
import numpy as np

from kinematics.arrays import Array
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.pose import align_z
from obstacles.convex.piece import Piece, PieceKind, convex_hull

#: FCL's units a metre.
UNITS = 1e5
#: Radius of the balls and capsules that stand for points and segments [m].
THIN = 1e-9
#: One triangle seen from both sides.
_TWO_SIDES = np.array([3, 0, 1, 2, 3, 2, 1, 0])
_REQUEST = fcl.DistanceRequest(enable_nearest_points=True)


@dataclass(frozen=True, slots=True, eq=False)
class FclSolid:
    """A piece for FCL; not to be shared between threads.

    Args:
        object: Object in FCL's units.
        T_piece_fcl: FCL's frame of it in the piece's frame, shape (4, 4).
        excess: Thickness that FCL's solid has too much, negative where it is the core of a rounded
            piece [m]. It is to be added to FCL's distances.
    """

    object: "fcl.CollisionObject"
    T_piece_fcl: Array
    excess: float

    def move(self, T: Array) -> None:
        """Move the piece to T, shape (4, 4)."""
        T_fcl = T @ self.T_piece_fcl
        self.object.setTransform(fcl.Transform(T_fcl[:3, :3], UNITS * T_fcl[:3, 3]))


class Separation(NamedTuple):
    """How far FCL finds two solids apart.

    Args:
        distance: Distance of the pieces [m].
        nearest: The nearest point of FCL's first solid, shape (3,) [units of FCL].
        other: Nearest point of the second solid, shape (3,) [units of FCL].
    """

    distance: float
    nearest: Array
    other: Array


def separation(a: FclSolid, b: FclSolid) -> Separation | None:
    """The distance of two solids by FCL; None where FCL's solids touch or overlap."""
    # A result that is used again keeps the nearest points of the smallest distance so far.
    result = fcl.DistanceResult()
    distance = fcl.distance(a.object, b.object, _REQUEST, result)
    if not distance > 0.0:
        return None
    nearest, other = result.nearest_points
    return Separation(distance / UNITS + a.excess + b.excess, nearest, other)


def fcl_solid(piece: Piece) -> FclSolid:
    """A piece as a solid of FCL, in the piece's own frame.

    A half-space has no finite solid: the caller has a closed form for it.

    Raises:
        ValueError: The piece is a half-space.
    """
    if piece.kind == PieceKind.HALFSPACE:
        raise ValueError("FCL has no finite solid of a half-space")
    # A triangle is asked about once, the others again and again.
    shape, T, excess = _new_shape(piece) if len(piece.vertices) == 3 else _shape(piece)
    # The shape may be shared, the object that is moved about may not.
    return FclSolid(fcl.CollisionObject(shape), T, excess)


def fcl_point() -> FclSolid:
    """A point that can be moved about: a ball of radius ``THIN``."""
    return FclSolid(fcl.CollisionObject(fcl.Sphere(UNITS * THIN)), np.eye(4), THIN)


def fcl_cube(side: float) -> FclSolid:
    """A cube of a side [m], centred."""
    return FclSolid(fcl.CollisionObject(fcl.Box(*([UNITS * side] * 3))), np.eye(4), 0.0)


@bounded_cache(maxsize=4096)
def _shape(piece: Piece) -> tuple["fcl.CollisionGeometry", Array, float]:
    """FCL's shape of a piece with its frame and excess; a robot's are asked for in every plan."""
    return _new_shape(piece)


def _new_shape(piece: Piece) -> tuple["fcl.CollisionGeometry", Array, float]:
    T = np.eye(4)
    rounding = piece.offset_radius
    if piece.kind != PieceKind.POLYTOPE:
        kind = fcl.Cylinder if piece.kind == PieceKind.CYLINDER else fcl.Cone
        return kind(UNITS * piece.radius, 2.0 * UNITS * piece.half_height), T, -rounding
    half = piece.box_half_sizes()
    if half is not None:
        return fcl.Box(*(2.0 * UNITS * half)), T, -rounding
    points = piece.vertices
    if len(points) == 3 and np.linalg.norm(np.cross(*(points[1:] - points[0]))) > 0.0:
        return fcl.Convex(UNITS * points, 2, _TWO_SIDES), T, -rounding
    hull = convex_hull(points)
    if len(hull.vertices) > 2:
        faces = hull.triangles
        if not hull.solid:
            faces = np.vstack([faces, faces[:, ::-1]])
        counted = np.hstack([np.full((len(faces), 1), 3), faces]).ravel()
        return fcl.Convex(UNITS * hull.vertices, len(faces), counted), T, -rounding
    first, last = (points[0], points[-1]) if len(points) <= 2 else hull.vertices[[0, -1]]
    T[:3, 3] = 0.5 * (first + last)
    length = float(np.linalg.norm(last - first))
    if length == 0.0:
        return fcl.Sphere(UNITS * THIN), T, THIN - rounding
    T[:3, :3] = align_z(last - first)
    return fcl.Capsule(UNITS * THIN, UNITS * length), T, THIN - rounding
