"""Whether something is inside of a mesh in one configuration, without touching its surface.

Where no surfaces touch all along a motion, nothing gets in or out: one look at its start will do.
Each body of each solid is looked up in all closed bodies of each mesh, by code of the proof alone.
"""

from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.caches.bounded_cache import array_bytes, bounded_cache
from kinematics.forward import joint_frames
from obstacles.convex.piece import Piece, PieceKind
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from obstacles.shapes.primitives import Primitive
from planning.proof.collision.mesh_solids import MeshSolids, mesh_solids

_HALF = int(Primitive.HALFSPACE)
_NO_POINTS, _NOTHING = np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
#: Part of a solid's size that it is thick at least.
_FLAT = 1e-9


class _Meshes(NamedTuple):
    """Meshes with an inside, and a point of each body of everything (k meshes, p points).

    Args:
        solids: The meshes, each in its own frame.
        poses: Frames of the meshes in those that carry them, shape (k, 4, 4).
        owners: Owner of each mesh, shape (k,).
        points: Shape (p, 3) [m].
        sources: Owner of each point, shape (p,).
        opened: Owners of meshes with a body that has no inside.
    """

    solids: tuple[MeshSolids, ...]
    poses: Array
    owners: Indices
    points: Array
    sources: Indices
    opened: tuple[int, ...]


def first_inside(robot: RobotGeometry, scene: Scene, q: Array) -> tuple[str, str] | None:
    """The link, and the obstacle or other link, one of which is inside a mesh that the other is.

    Only bodies that lie inside as a whole are sure to be found.

    Args:
        robot: The robot.
        scene: Scene around the robot.
        q: Shape (n,).
    """
    own = _of_robot(robot)
    if not own.solids and not scene.has_meshes:
        return None
    around = _of_scene(scene)
    frames = np.concatenate([np.eye(4)[None], joint_frames(robot.chain, q)])
    carried = frames[robot.joints + 1]
    T = carried[own.sources]
    points = (T[:, :3, :3] @ own.points[..., None])[..., 0] + T[:, :3, 3]
    moving = robot.joints[own.sources] >= 0
    for solid, pose, owner in zip(own.solids, own.poses, own.owners.tolist(), strict=True):
        name, T_world = robot.links[owner], carried[owner] @ pose
        apart = robot.joints[own.sources] != robot.joints[owner]
        for k in _held(solid, T_world, points, np.flatnonzero(apart)):
            other = robot.links[own.sources[k]]
            if not scene.allows(name, other) and _sorted(name, other) not in robot.allowed:
                return other, name
        if robot.joints[owner] >= 0:
            for k in _held(solid, T_world, around.points, np.arange(len(around.points))):
                if not scene.allows(name, scene.ids[around.sources[k]]):
                    return name, scene.ids[around.sources[k]]
    for solid, pose, owner in zip(around.solids, around.poses, around.owners.tolist(), strict=True):
        for k in _held(solid, pose, points, np.flatnonzero(moving)):
            if not scene.allows(robot.links[own.sources[k]], scene.ids[owner]):
                return robot.links[own.sources[k]], scene.ids[owner]
    return None


def open_meshes(robot: RobotGeometry, scene: Scene) -> tuple[str, ...]:
    """Names of links, attached objects and obstacles of which a mesh has a body without an inside.

    Args:
        robot: The robot with what it holds.
        scene: Scene around the robot.
    """
    own = [robot.links[piece] for piece in _of_robot(robot).opened]
    opened = _of_scene(scene).opened if scene.has_meshes else ()
    around = [scene.ids[number] for number in opened]
    return tuple(dict.fromkeys([*own, *around]))


def _held(solid: MeshSolids, T: Array, points: Array, chosen: Indices) -> Indices:
    """Whether chosen points are inside of a mesh that is placed by T (4, 4)."""
    local = (points[chosen] - T[:3, 3]) @ T[:3, :3]
    return np.asarray(chosen[solid.hold(local)])


def _sorted(a: str, b: str) -> tuple[str, str]:
    return (a, b) if a < b else (b, a)


@bounded_cache(maxsize=8)
def _of_robot(robot: RobotGeometry) -> _Meshes:
    """Its meshes and points in the frames of its joints; what they belong to are pieces."""
    found = _Found()
    for number, piece in enumerate(robot.pieces):
        found.add(piece, number, int(robot.solids[number]))
    return found.packed()


@bounded_cache(maxsize=8)
def _of_scene(scene: Scene) -> _Meshes:
    """Meshes of obstacles in the root frame; their owners are obstacles."""
    found = _Found()
    primitives, kinds = scene.primitives, iter(scene.primitives.kinds.tolist())
    whole = [i for i, o in enumerate(scene.obstacles) if o.is_primitive and next(kinds) != _HALF]
    for number, obstacle in enumerate(scene.obstacles):
        if obstacle.is_cloud:
            found.note(obstacle.balls().centers, number)
        elif not obstacle.is_primitive:
            for piece in obstacle.pieces():
                found.add(piece, number, number, obstacle.is_mesh)
    middles = primitives.poses[primitives.kinds != _HALF, :3, 3]
    return found.packed(middles, np.array(whole, dtype=np.int64))


class _Found:
    """Meshes and points that are gathered piece by piece."""

    def __init__(self) -> None:
        self._solids = list[MeshSolids]()
        self._poses = list[Array]()
        self._owners = list[int]()
        self._points = list[Array]()
        self._sources = list[Indices]()
        self._opened = list[int]()
        self._meshes = set[tuple[int, int, bytes] | None]()

    def add(self, piece: Piece, owner: int, solid: int, may_be_mesh: bool = True) -> None:
        """Note a piece, and the mesh that it is a part of where that is not known.

        Args:
            piece: Piece in the frame of what carries it.
            owner: Owner of the piece.
            solid: Number of the solid of which it is a part.
            may_be_mesh: Whether a flat piece is an open mesh.
        """
        T, points = piece.T_owner_piece, piece.vertices[:1]
        if piece.kind == PieceKind.HALFSPACE:
            return
        mark = None if piece.surface is None else (solid, id(piece.surface.mesh), T.tobytes())
        if piece.surface is None:
            self._opened += [owner] if may_be_mesh and _is_flat(piece) else []
        elif mark in self._meshes:
            return
        else:
            self._meshes.add(mark)
            mesh = _solids(piece.surface.mesh.tobytes())
            points = mesh.points
            self._opened += [owner] if mesh.opened else []
            if len(mesh.low):
                self._solids.append(mesh)
                self._poses.append(T)
                self._owners.append(owner)
        points = points if len(points) else np.zeros((1, 3))
        self.note(points @ T[:3, :3].T + T[:3, 3], owner)

    def note(self, points: Array, owner: int) -> None:
        """Note points (k, 3) of what carries them."""
        self._points.append(points)
        self._sources.append(np.full(len(points), owner))

    def packed(self, points: Array = _NO_POINTS, sources: Indices = _NOTHING) -> _Meshes:
        """All of them, behind points that are known already, (p, 3), and what these belong to."""
        return _Meshes(
            tuple(self._solids),
            np.array(self._poses).reshape(-1, 4, 4),
            np.array(self._owners, dtype=np.int64),
            np.concatenate([points, *self._points]),
            np.concatenate([sources, *self._sources]),
            tuple(dict.fromkeys(self._opened)),
        )


def _is_flat(piece: Piece) -> bool:
    """Whether a piece is a surface with nothing behind it."""
    corners = piece.vertices
    if piece.kind != PieceKind.POLYTOPE or piece.offset_radius > 0.0 or len(corners) < 3:
        return False
    across = corners[1:] - corners[0]
    return bool(np.linalg.matrix_rank(across, tol=_FLAT * float(np.abs(across).max())) < 3)


#: A scene has several meshes, and stays the same from request to request.
@bounded_cache(maxsize=64, weigh=array_bytes)
def _solids(triangles: bytes) -> MeshSolids:
    return mesh_solids(np.frombuffer(triangles).reshape(-1, 3, 3))
