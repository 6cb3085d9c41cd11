"""Whether something is inside of a mesh in one configuration, without touching its surface.

Where no surfaces touch all along a motion, nothing gets in or out: one look at its start will do.
"""

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, Indices
from kinematics.bounded_cache import bounded_cache
from kinematics.forward import joint_frames
from obstacles.mesh_containment import encloses, inside_box
from obstacles.piece import Piece, PieceKind
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene


def first_inside(robot: RobotGeometry, scene: Scene, q: Array) -> tuple[str, str] | None:
    """The link, and the obstacle or other link, one of which is inside a mesh that the other is.

    Only bodies that lie inside as a whole are sure to be found.

    Args:
        robot: The robot.
        scene: What stands around.
        q: Shape (n,).
    """
    frames = np.concatenate([np.eye(4)[None], joint_frames(robot.chain, q)])
    carried = frames[robot.joints + 1]
    return _own(robot, scene, carried) or _around(robot, scene, carried)


def _own(robot: RobotGeometry, scene: Scene, carried: Array) -> tuple[str, str] | None:
    pieces, links = robot.pieces, robot.links
    solids = [i for i, piece in enumerate(pieces) if _bounds(piece)]
    if not solids:
        return None
    centers = carried @ np.append(robot.arrays.centers, np.ones((len(pieces), 1)), 1)[..., None]
    i, j = robot.self_pairs.T
    gaps = np.linalg.norm(centers[i, :3, 0] - centers[j, :3, 0], axis=1)
    near = robot.self_pairs[gaps <= robot.arrays.radii[i] + robot.arrays.radii[j]]
    if scene.allowed_collisions:
        near = near[[not scene.allows(links[a], links[b]) for a, b in near]]
    points, owners = _placed_points(robot, carried)
    for solid in solids:
        others = np.zeros(len(pieces), dtype=np.bool_)
        others[near[near[:, 0] == solid, 1]] = others[near[near[:, 1] == solid, 0]] = True
        chosen = np.flatnonzero(others[owners])
        held = chosen[_holds(pieces, solid, carried[solid], points[chosen])]
        if len(held):
            return links[owners[held[0]]], links[solid]
    return None


def _around(robot: RobotGeometry, scene: Scene, carried: Array) -> tuple[str, str] | None:
    pieces, links = robot.pieces, robot.links
    moving = [i for i in range(len(pieces)) if robot.joints[i] >= 0]
    solids = [i for i in moving if _bounds(pieces[i])]
    if solids:
        owners, points = scene.pieces()[1], _places(scene)
        for i in solids:
            center = carried[i, :3, :3] @ robot.arrays.centers[i] + carried[i, :3, 3]
            near = np.flatnonzero(np.abs(points[0] - center[0]) <= robot.arrays.radii[i])
            for k in near[_holds(pieces, i, carried[i], points[:, near].T)]:
                name = scene.ids[int(owners[k])]
                if not scene.allows(links[i], name):
                    return links[i], name
    return _in_obstacles(robot, scene, carried)


def _in_obstacles(robot: RobotGeometry, scene: Scene, carried: Array) -> tuple[str, str] | None:
    """The moving link that is inside a mesh that stands around, and that mesh."""
    meshes = [obstacle for obstacle in scene.obstacles if obstacle.is_mesh]
    if not meshes:
        return None
    points, owners = _placed_points(robot, carried)
    for obstacle in meshes:
        may_touch = [scene.allows(link, obstacle.id) for link in robot.links]
        chosen = np.flatnonzero(((robot.joints >= 0) & ~np.array(may_touch))[owners])
        own = obstacle.pieces()
        for k in (k for k, piece in enumerate(own) if _bounds(piece)):
            held = chosen[_holds(own, k, np.eye(4), points[chosen])]
            if len(held):
                return robot.links[owners[held[0]]], obstacle.id
    return None


def _bounds(piece: Piece) -> bool:
    """Whether a piece is a part of a solid that its triangles bound."""
    return piece.surface is not None and piece.surface.count > 0


def _holds(pieces: tuple[Piece, ...], i: int, carried: Array, points: Array) -> NDArray[np.bool_]:
    """Which of ``points`` (m, 3) are in the cover that piece i is, and in its solid, (m,)."""
    T, surface = carried @ pieces[i].T_owner_piece, pieces[i].surface
    assert surface is not None
    held = inside_box(pieces[i], T, points)
    if held.any():
        first = i - surface.place
        group = pieces[first : first + surface.count]
        held[held] = encloses(group, T, points[held])
    return held


@bounded_cache(maxsize=8)
def _places(scene: Scene) -> Array:
    """A point of every piece, far away where it is a half-space, shape (3, m)."""
    still = scene.pieces()[0]
    local = np.zeros((len(still), 3))
    cornered = np.flatnonzero(np.diff(still.starts))
    local[cornered] = still.vertices[still.starts[cornered]]
    places = (still.poses[:, :3, :3] @ local[..., None])[..., 0] + still.poses[:, :3, 3]
    places[still.kinds == PieceKind.HALFSPACE] = np.inf
    return np.ascontiguousarray(places.T)


def _placed_points(robot: RobotGeometry, carried: Array) -> tuple[Array, Indices]:
    """A point of each body of each piece in the world, (m, 3), and the pieces they are of, (m,)."""
    points, owners = _points(robot)
    T = carried[owners]
    return (T[:, :3, :3] @ points[..., None])[..., 0] + T[:, :3, 3], owners


@bounded_cache(maxsize=8)
def _points(robot: RobotGeometry) -> tuple[Array, Indices]:
    """``_placed_points`` in the frames of the joints."""
    own = [_points_of(piece) for piece in robot.pieces]
    return np.concatenate(own), np.repeat(np.arange(len(own)), [len(points) for points in own])


def _points_of(piece: Piece) -> Array:
    """A point of each body that a piece is made of, in its owner's frame, (m, 3)."""
    T = piece.T_owner_piece
    if piece.kind == PieceKind.HALFSPACE:
        return np.zeros((0, 3))
    if piece.surface is not None:
        points = piece.surface.anchors
    elif piece.kind == PieceKind.POLYTOPE:
        points = piece.vertices[:1]
    else:
        points = np.zeros((1, 3))
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])
