"""Distance of two convex pieces: proposed by FCL, proved by a separating plane."""

import numpy as np

from kinematics.arrays import Array
from obstacles.convex.piece import Piece, PieceKind
from obstacles.distance.fcl_solid import Separation, fcl_solid, separation
from obstacles.distance.signed_distance import halfspace_distance, plane_bound, signed_distance

#: What is answered is a lower bound of the distance and at most this far below it [m]; for
#: overlapping round solids that are coaxial, 1e-3 of their size.
ACCURACY = 1e-7


def convex_distance(a: Piece, T_a: Array, b: Piece, T_b: Array) -> float:
    """Distance of two convex pieces at T_a and T_b (4, 4) each, proved, by FCL [m]."""
    if b.kind == PieceKind.HALFSPACE:
        return halfspace_distance(a, T_a, T_b)
    if a.kind == PieceKind.HALFSPACE:
        return halfspace_distance(b, T_b, T_a)
    one, other = fcl_solid(a), fcl_solid(b)
    one.move(T_a)
    other.move(T_b)
    return proved_distance(separation(one, other), a, T_a, b, T_b)


def proved_distance(
    proposed: Separation | None, a: Piece, T_a: Array, b: Piece, T_b: Array
) -> float:
    """The distance of two pieces that FCL proposes, where a plane proves it; else our own.

    Args:
        proposed: FCL's answer, None where its solids touch.
        a: One convex piece, not a half-space.
        T_a: Pose of the first piece, shape (4, 4).
        b: The other.
        T_b: Pose of the second piece, shape (4, 4).

    Returns:
        A lower bound of the distance, within ``ACCURACY`` [m].
    """
    if proposed is not None:
        proved = _plane_bound(a, T_a, b, T_b, proposed.other - proposed.nearest)
        if proposed.distance - proved <= ACCURACY:
            return proved
    return signed_distance(a, T_a, b, T_b)[0]


def _plane_bound(a: Piece, T_a: Array, b: Piece, T_b: Array, towards: Array) -> float:
    """The lower bound of the distance that a plane across a direction from a to b proves [m]."""
    proved = plane_bound(
        int(a.kind), a.vertices, np.array([a.radius, a.half_height, a.offset_radius]), T_a,
        int(b.kind), b.vertices, np.array([b.radius, b.half_height, b.offset_radius]), T_b,
        np.asarray(towards),
    )  # fmt: skip
    return proved - a.offset_radius - b.offset_radius
