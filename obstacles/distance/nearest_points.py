"""Nearest points of two convex pieces."""

from dataclasses import dataclass

import numpy as np

from kinematics.arrays import Array
from obstacles.convex.piece import Piece
from obstacles.distance.fcl_solid import UNITS, FclSolid, separation
from obstacles.distance.signed_distance import support

#: Points nearer than this have no direction between them [m].
_APART = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class NearestPoints:
    """The closest pair of a robot in a scene.

    Args:
        distance: Distance between the two, negative by the depth where they overlap [m]; infinite
            where nothing can collide.
        pair: Names of the pair; None where nothing can collide.
        points: Points on the first and on the second, in the root frame, shape (2, 3) [m]; None
            where they touch or triangles decide.
    """

    distance: float
    pair: tuple[str, str] | None
    points: Array | None = None


def on_plane(piece: Piece, T: Array, T_halfspace: Array) -> Array:
    """The lowest point of a piece above a half-space, and the point below it, shape (2, 3) [m].

    Args:
        piece: Not a half-space.
        T: Pose of the piece, shape (4, 4).
        T_halfspace: Pose of the half-space z <= 0, shape (4, 4).
    """
    normal = np.ascontiguousarray(T_halfspace[:3, 2])
    lowest = support(piece, T, -normal) - piece.offset_radius * normal
    height = float(normal @ (lowest - T_halfspace[:3, 3]))
    return np.array([lowest, lowest - height * normal])


def between(a: FclSolid, b: FclSolid) -> Array | None:
    """The nearest points of two solids by FCL, shape (2, 3) [m]; None where they touch."""
    found = separation(a, b)
    if found is None:
        return None
    first, second = found.nearest / UNITS, found.other / UNITS
    towards = (second - first) / max(float(np.linalg.norm(second - first)), _APART)
    # FCL's solid of a rounded piece may be its core: the points move out to the surface.
    return np.array([first - towards * a.excess, second + towards * b.excess])
