"""Collision by python-fcl alone, from the shapes of a robot and a scene: what verdicts are held to.

Solids are given to FCL in hundredths of a millimetre, where its iterations stop early enough not to
matter; of a mesh that is not convex the triangles, and what lies inside of them is told by their
winding number. Pairs whose bounding balls are apart are not asked about; all others are.
"""

import fcl
import numpy as np
import trimesh

from benchmarks.judges.triangles import winding_numbers
from kinematics.arrays import Array
from kinematics.forward import joint_frames
from kinematics.pose import align_z
from obstacles.convex.piece import Piece, PieceKind, convex_hull
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene

_UNITS = 1e5


class FclJudge:
    """A robot among obstacles, margins left out."""

    def __init__(self, robot: RobotGeometry, scene: Scene) -> None:
        self._robot, p = robot, len(robot.pieces)
        pieces, names = list(robot.pieces), list(robot.links)
        for obstacle in scene.obstacles:
            own = obstacle.pieces()
            pieces += own
            names += [obstacle.id] * len(own)
        self._pieces = pieces
        made = [_solid(piece) for piece in pieces]
        self._objects = [fcl.CollisionObject(shape) for shape, _ in made]
        owned = np.array([piece.T_owner_piece for piece in pieces])
        self._frames = owned @ np.array([T for _, T in made])
        balls = [piece.bounding_sphere() for piece in pieces]
        self._centers = np.array([center for center, _ in balls])
        self._radii = np.array([radius for _, radius in balls])
        pairs = [
            (i, k)
            for i in np.flatnonzero(robot.joints >= 0)
            for k in range(p, len(pieces))
            if not scene.allows(names[i], names[k])
        ]
        pairs += [
            tuple(pair) for pair in robot.self_pairs if not scene.allows(*(names[i] for i in pair))
        ]
        self._pairs = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        for k in range(p, len(pieces)):
            self._place(k, self._frames[k])

    def collides(self, q: Array) -> bool:
        """Whether any pair touches in a configuration (n,)."""
        robot, p = self._robot, len(self._robot.pieces)
        frames = np.concatenate([np.eye(4)[None], joint_frames(robot.chain, q)])[robot.joints + 1]
        gaps = self._gaps(frames)
        placed: set[int] = set()
        for a, b in self._pairs[gaps <= 0.0]:
            for k in (int(a), int(b)):
                if k < p and k not in placed:
                    placed.add(k)
                    self._place(k, frames[k] @ self._frames[k])
            if self._touch(int(a), int(b)):
                return True
        return False

    def obstacle_distance(self, q: Array) -> float:
        """Least distance of a moving link from an obstacle, 0 where they touch, q (n,) [m]."""
        robot, p = self._robot, len(self._robot.pieces)
        frames = np.concatenate([np.eye(4)[None], joint_frames(robot.chain, q)])[robot.joints + 1]
        for k in range(p):
            self._place(k, frames[k] @ self._frames[k])
        pairs, gaps = self._pairs, self._gaps(frames)
        order = np.argsort(gaps)
        least = np.inf
        for k in order[pairs[order, 1] >= p]:
            if gaps[k] >= least:
                break
            least = min(least, max(self._distance(*pairs[k].tolist()), 0.0))
        return least

    def _gaps(self, frames: Array) -> Array:
        """What bounding balls prove of the distance of each pair [m].

        Args:
            frames: That carry the pieces of the robot, shape (p, 4, 4).
        """
        p, centers = len(frames), self._centers.copy()
        centers[:p] = np.einsum("kij,kj->ki", frames[:, :3, :3], centers[:p]) + frames[:, :3, 3]
        i, j = self._pairs.T
        apart = np.linalg.norm(centers[i] - centers[j], axis=1)
        return np.asarray(apart - self._radii[i] - self._radii[j])

    def _distance(self, a: int, b: int) -> float:
        """Distance of two pieces that do not touch [m]."""
        if self._pieces[b].kind == PieceKind.HALFSPACE and self._pieces[a].surface is not None:
            return self._height(a, b)
        rounding = _left_over(self._pieces[a]) + _left_over(self._pieces[b])
        return float(fcl.distance(self._objects[a], self._objects[b])) / _UNITS - rounding

    def _height(self, a: int, b: int) -> float:
        """Height of the lowest corner of a mesh above a half-space, which FCL can't tell [m]."""
        surface = self._pieces[a].surface
        assert surface is not None
        mesh, plane = (self._objects[k].getTransform() for k in (a, b))
        corners = surface.triangles.reshape(-1, 3) @ mesh.getRotation().T
        corners += (mesh.getTranslation() - plane.getTranslation()) / _UNITS
        return float((corners @ plane.getRotation()[:, 2]).min())

    def _place(self, k: int, T: Array) -> None:
        self._objects[k].setTransform(fcl.Transform(T[:3, :3], _UNITS * T[:3, 3]))

    def _touch(self, a: int, b: int) -> bool:
        if self._pieces[b].kind == PieceKind.HALFSPACE and self._pieces[a].surface is not None:
            return self._height(a, b) <= 0.0
        rounding = _left_over(self._pieces[a]) + _left_over(self._pieces[b])
        one, other = self._objects[a], self._objects[b]
        if rounding > 0.0 and fcl.distance(one, other) <= _UNITS * rounding:
            return True
        return bool(fcl.collide(one, other)) or self._holds(a, b) or self._holds(b, a)

    def _holds(self, outer: int, inner: int) -> bool:
        """Whether a piece that touches no triangle is inside of the solid that they bound."""
        surface = self._pieces[outer].surface
        if surface is None or not surface.count:
            return False
        first = outer - surface.place
        corners = [
            piece.surface.triangles.reshape(-1, 3)
            for piece in self._pieces[first : first + surface.count]
            if piece.surface is not None
        ]
        there, here = (self._objects[k].getTransform() for k in (inner, outer))
        solid = self._pieces[inner]
        point = np.zeros(3) if solid.surface is None else solid.surface.triangles[0, 0]
        if len(solid.vertices) > 2 and solid.surface is None:
            point = solid.vertices.mean(axis=0)
        point = there.getRotation() @ point + there.getTranslation() / _UNITS
        point = here.getRotation().T @ (point - here.getTranslation() / _UNITS)
        faces = np.arange(sum(map(len, corners))).reshape(-1, 3)
        mesh = trimesh.Trimesh(np.vstack(corners), faces, process=False)
        return bool(winding_numbers(mesh, point[None])[0] > 0.5)


def _left_over(piece: Piece) -> float:
    """The rounding that FCL's solid does not have."""
    return piece.offset_radius if len(piece.vertices) > 2 and piece.surface is None else 0.0


def _solid(piece: Piece) -> "tuple[fcl.CollisionGeometry, Array]":
    """FCL's solid and its frame in the piece's."""
    T = np.eye(4)
    if piece.surface is not None:
        corners = piece.surface.triangles.reshape(-1, 3)
        mesh = fcl.BVHModel()
        mesh.beginModel(len(corners), len(corners) // 3)
        mesh.addSubModel(_UNITS * corners, np.arange(len(corners)).reshape(-1, 3))
        mesh.endModel()
        return mesh, T
    if piece.kind == PieceKind.HALFSPACE:
        return fcl.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0), T
    if piece.kind != PieceKind.POLYTOPE:
        kind = fcl.Cylinder if piece.kind == PieceKind.CYLINDER else fcl.Cone
        return kind(_UNITS * piece.radius, 2.0 * _UNITS * piece.half_height), T
    half = piece.box_half_sizes()
    if half is not None:
        return fcl.Box(*(2.0 * _UNITS * half)), T
    points = piece.vertices
    if len(points) <= 2:
        T[:3, 3], along = points.mean(axis=0), points[-1] - points[0]
        length = float(np.linalg.norm(along))
        if length == 0.0:
            return fcl.Sphere(_UNITS * piece.offset_radius), T
        T[:3, :3] = align_z(along)
        return fcl.Capsule(_UNITS * piece.offset_radius, _UNITS * length), T
    hull = convex_hull(points)
    counted = np.hstack([np.full((len(hull.triangles), 1), 3), hull.triangles]).ravel()
    return fcl.Convex(_UNITS * hull.vertices, len(hull.triangles), counted), T
