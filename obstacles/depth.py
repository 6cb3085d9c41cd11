"""How deep two overlapping convex pieces are inside each other.

The depth is the shortest translation that parts them: the distance from the origin to the boundary
of the Minkowski difference A - B. A polytope inside A - B grows by one support point at a time
where it is nearest to the origin, so that

    its nearest plane  <=  depth  <=  n.w of the support w along that plane's normal n

holds throughout. Source: "Proximity queries and penetration depth computation on 3D game objects",
Game Developers Conference, 2001 (the expanding polytope algorithm), with the polytope left to
Qhull.
"""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from kinematics.chain import Array
from obstacles.piece import Piece, PieceKind

#: Gap between the bounds at which the depth counts as found [m].
_GAP = 1e-8
_MAX_SUPPORTS = 400
_FIRST = np.array(
    [[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z],
    dtype=np.float64,
)


def supports(piece: Piece, T: Array, directions: Array) -> Array:
    """Farthest points of a piece's core along each of ``directions`` (m, 3), shape (m, 3).

    Args:
        piece: Any but a half-space.
        T: The piece's frame in the frame of the directions, shape (4, 4).
        directions: Of any length but 0.
    """
    local = directions @ T[:3, :3]
    if piece.kind == PieceKind.POLYTOPE:
        points = piece.vertices[(local @ piece.vertices.T).argmax(axis=1)]
    else:
        radial = np.linalg.norm(local[:, :2], axis=1, keepdims=True)
        unit = np.divide(local[:, :2], radial, out=np.zeros((len(local), 2)), where=radial > 0.0)
        points = np.empty_like(local)
        points[:, :2] = piece.radius * unit
        points[:, 2] = np.where(local[:, 2] >= 0.0, piece.half_height, -piece.half_height)
        if piece.kind == PieceKind.CONE:
            apex = np.array([0.0, 0.0, piece.half_height])
            base = points.copy()
            base[:, 2] = -piece.half_height
            higher = (local @ apex) >= np.einsum("ij,ij->i", local, base)
            points = np.where(higher[:, None], apex, base)
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])


def halfspace_distance(piece: Piece, T: Array, T_halfspace: Array) -> float:
    """Signed distance of a piece to the half-space z <= 0 of its frame; exact [m]."""
    normal = T_halfspace[:3, 2]
    if piece.kind == PieceKind.HALFSPACE:
        return -np.inf
    lowest = supports(piece, T, -normal[None])[0]
    return float(normal @ (lowest - T_halfspace[:3, 3])) - piece.rounding


def penetration(a: Piece, T_a: Array, b: Piece, T_b: Array) -> float:
    """How far two pieces whose cores overlap have to be moved apart, to about 1e-8 m.

    Args:
        a: A piece, no half-space.
        T_a: Its frame, shape (4, 4).
        b: Another, no half-space.
        T_b: Its frame in the same frame, shape (4, 4).

    Returns:
        The depth, roundings included [m]; the roundings alone where the cores only touch.
    """
    rounding = a.rounding + b.rounding

    def difference(directions: Array) -> Array:
        return supports(a, T_a, directions) - supports(b, T_b, -directions)

    try:
        hull = ConvexHull(np.unique(difference(_FIRST), axis=0), incremental=True)
        best = np.inf
        for _ in range(_MAX_SUPPORTS):
            # Qhull's planes are n.x + o <= 0.
            nearest = int(np.argmax(hull.equations[:, 3]))
            normal, inner = hull.equations[nearest, :3], -float(hull.equations[nearest, 3])
            outermost = difference(normal[None])
            best = min(best, float(normal @ outermost[0]))
            if best - inner <= _GAP:
                break
            hull.add_points(outermost)
    except QhullError:
        # A difference without inside: two flat cores in one plane part by any step out of it.
        return rounding
    return max(best, 0.0) + rounding
