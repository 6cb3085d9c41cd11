"""Orthogonal projection of points onto obstacles by FCL's distance query.

FCL finds the nearest points of a ball of radius 1e-9 m about p and of every convex piece, given in
units of ten micrometres. Of a Minkowski sum of a core and a ball of radius r it is asked about the
core, whose nearest point is n:

    pi(p) = n + r (p - n) / |p - n|,    distance = |p - n| - r.

FCL has no nearest points of a half-space: a cube stands for it whose top face lies on its plane,
centred under p. Of a mesh that is not convex every triangle is a piece. Inside a core FCL tells
only that solids overlap: there, and inside of what triangles enclose, the closed forms of
``projection`` answer.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array
from kinematics.pose import transform
from obstacles.convex.piece import Piece, PieceArrays, PieceKind
from obstacles.distance.fcl_solid import UNITS, FclSolid, fcl_cube, fcl_point, fcl_solid, separation
from obstacles.projection.projection import Projector, checked_points, convex_parts
from obstacles.scenes.scene import Obstacle, Scene

#: Side of the cube that stands for a half-space [m]: of any size, as its top centre is the nearest.
_CUBE_SIDE = 1.0


class FclProjector:
    """Projects points onto the same obstacles again and again, by FCL.

    Not to be shared between threads.

    Args:
        obstacles: A scene, or obstacles; their margins are no part of them.
    """

    def __init__(self, obstacles: Scene | Sequence[Obstacle]) -> None:
        solids = obstacles.obstacles if isinstance(obstacles, Scene) else tuple(obstacles)
        self.ids = tuple(obstacle.id for obstacle in solids)
        self._targets = [_Target(obstacle) for obstacle in solids]
        self._point = fcl_point()

    def __call__(self, points: ArrayLike, within: Array | None = None) -> tuple[Array, Array]:
        """Project points onto every obstacle, as ``projection.Projector`` does.

        Args:
            points: Shape (m, 3) [m].
            within: Distance from a point beyond which obstacles may be left out: their distance is
                infinite, their projection NaN; shape (m,) [m]. None for everything.

        Returns:
            pi(p) for each point and obstacle, shape (m, o, 3) [m]; the signed distance, negative
            inside, shape (m, o) [m].

        Raises:
            InvalidScene: Wrong shape or not finite.
        """
        checked = checked_points(points)
        projections = np.full((len(checked), len(self.ids), 3), np.nan)
        distances = np.full((len(checked), len(self.ids)), np.inf)
        reach = np.full(len(checked), np.inf) if within is None else within
        for i, point in enumerate(checked):
            self._point.move(transform(position=point))
            for k, target in enumerate(self._targets):
                projections[i, k], distances[i, k] = self._project(point, target, float(reach[i]))
        return projections, distances

    def _project(self, point: Array, target: "_Target", reach: float) -> tuple[Array, float]:
        """pi(p) of one point and one obstacle, shape (3,) [m], and the signed distance [m]."""
        if target.encloses(point):
            return target.closed_form(point)
        projection, distance = np.full(3, np.nan), np.inf
        bounds = np.linalg.norm(target.centers - point, axis=1) - target.radii
        for i in np.argsort(bounds):
            if bounds[i] >= max(distance, 0.0) or bounds[i] > reach:
                break
            solid = target.solid(int(i), point)
            between = separation(self._point, solid)
            if between is None:
                return target.closed_form(point)
            if between.distance < distance:
                distance, nearest = between.distance, between.other / UNITS
                outward = (point - nearest) / np.linalg.norm(point - nearest)
                projection = nearest - solid.excess * outward
        return projection, distance


class _Target:
    """One obstacle as solids of FCL, made when they are first asked about.

    Args:
        obstacle: Obstacle of any shape.
    """

    def __init__(self, obstacle: Obstacle) -> None:
        self._obstacle = obstacle
        self._solids: dict[int, FclSolid] = {}
        self._convex: tuple[Piece, ...] = ()
        self._triangles = np.zeros((0, 3, 3))
        self._is_filled = False
        if obstacle.is_cloud:
            balls = obstacle.balls()
            self.centers, self.radii = balls.centers, balls.radii
            return
        parts, enclosing = convex_parts(obstacle)
        self._is_filled = enclosing > 0
        self._convex = tuple(part for part in parts if part.surface is None)
        surfaces = [_triangles(part) for part in parts if part.surface is not None]
        self._triangles = np.concatenate([self._triangles, *surfaces])
        arrays, middles = PieceArrays.pack(self._convex), self._triangles.mean(axis=1)
        reach = np.linalg.norm(self._triangles - middles[:, None], axis=2).max(axis=1, initial=0.0)
        self.centers = np.vstack([arrays.centers, middles])
        self.radii = np.concatenate([arrays.radii, reach])

    def solid(self, i: int, point: Array) -> FclSolid:
        """Solid i; one that stands for a half-space is moved under the point, shape (3,)."""
        piece = self._piece(i)
        if i not in self._solids:
            is_plane = piece.kind == PieceKind.HALFSPACE
            self._solids[i] = fcl_cube(_CUBE_SIDE) if is_plane else fcl_solid(piece)
            self._solids[i].move(piece.T_owner_piece)
        solid = self._solids[i]
        if piece.kind == PieceKind.HALFSPACE:
            T = piece.T_owner_piece
            height = float(T[:3, 2] @ (point - T[:3, 3]))
            # About a point inside, so that FCL finds them overlapping however deep it is.
            down = height + 0.5 * _CUBE_SIDE if height > 0.0 else 0.0
            solid.move(transform(T[:3, :3], point - down * T[:3, 2]))
        return solid

    def _piece(self, i: int) -> Piece:
        if self._obstacle.is_cloud:
            return self._obstacle.piece(i)
        if i < len(self._convex):
            return self._convex[i]
        corners = self._triangles[i - len(self._convex)]
        return Piece(PieceKind.POLYTOPE, np.eye(4), corners)

    def encloses(self, point: Array) -> bool:
        """Whether a point, shape (3,), is inside of what the obstacle's triangles enclose."""
        return self._is_filled and self.closed_form(point)[1] < 0.0

    def closed_form(self, point: Array) -> tuple[Array, float]:
        """pi(p) of a point, shape (3,), and the signed distance by ``projection``."""
        projections, distances = self._exact(point[None])
        return projections[0, 0], float(distances[0, 0])

    @cached_property
    def _exact(self) -> Projector:
        return Projector([self._obstacle])


def _triangles(part: Piece) -> Array:
    """The triangles that a piece of a mesh covers, in the world, shape (t, 3, 3) [m]."""
    assert part.surface is not None
    T = part.T_owner_piece
    return np.asarray(part.surface.triangles @ T[:3, :3].T + T[:3, 3])
