"""Obstacles of the scene editor: new ones, their sizes and scaling, and those of files.

Files are scenes in JSON, planning scenes of MoveIt, and meshes. The readers are the application's
own, so that a file means here what it means to the service.
"""

from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from armwright_client import (
    Box,
    Capsule,
    Cone,
    Convex,
    Cylinder,
    FramedPose,
    Halfspace,
    Mesh,
    Obstacle,
    PointCloud,
    Pose,
    Scene,
    Sphere,
)
from armwright_wire.scenes.scene import Shape
from obstacles.meshes.mesh import FILE_TYPES, load_mesh
from obstacles.scenes.moveit import scene_from_moveit
from studio.pose import rotation

ShapeKind = Literal["box", "sphere", "cylinder"]
#: Edge, diameter and height of a new obstacle [m]: a box that a gripper holds.
_SIZE = 0.1
#: Endings of planning scenes of MoveIt.
MOVEIT = ("yaml", "yml", "scene")
#: A mesh that is larger than this was meant in millimetres [m].
_LARGEST = 50.0
_FramePose = Callable[[str], Pose]
_SHAPES: dict[str, Any] = {
    kind.__name__: kind
    for kind in (Box, Sphere, Cylinder, Capsule, Cone, Halfspace, Convex, Mesh, PointCloud)
}


def new_obstacle(
    kind: ShapeKind, obstacle_id: str, position: tuple[float, float, float]
) -> Obstacle:
    """A new obstacle of the usual size.

    Args:
        kind: Kind of the shape.
        obstacle_id: Id of the obstacle.
        position: Position of the centre in the root frame [m].
    """
    shapes: dict[ShapeKind, Shape] = {
        "box": Box(size=[_SIZE, _SIZE, _SIZE]),
        "sphere": Sphere(radius=0.5 * _SIZE),
        "cylinder": Cylinder(radius=0.5 * _SIZE, height=_SIZE),
    }
    return Obstacle(id=obstacle_id, shape=shapes[kind], pose=Pose.at(*position))


def dimensions(shape: Shape) -> dict[str, float]:
    """Sizes that the editor changes [m], by name; empty for shapes that it does not scale."""
    match shape:
        case Box():
            return dict(zip("xyz", shape.size, strict=True))
        case Sphere():
            return {"radius": shape.radius}
        case Cylinder() | Capsule() | Cone():
            return {"radius": shape.radius, "height": shape.height}
        case _:
            return {}


def with_dimension(obstacle: Obstacle, name: str, value: float) -> Obstacle:
    """The obstacle with one of its sizes changed.

    Args:
        obstacle: The obstacle.
        name: One of `dimensions`.
        value: The new size [m].
    """
    sizes = dimensions(obstacle.shape) | {name: value}
    shape = obstacle.shape
    changed: Shape
    if isinstance(shape, Box):
        changed = Box(size=[sizes[axis] for axis in "xyz"])
    else:
        changed = type(shape).of(**sizes)
    return obstacle.model_copy(update={"shape": changed})


def corner(shape: Shape) -> tuple[float, float, float] | None:
    """Place of the handle that scales a shape, in its own frame [m]; None if it has none."""
    match shape:
        case Box():
            x, y, z = shape.size
            return 0.5 * x, 0.5 * y, 0.5 * z
        case Sphere():
            return shape.radius, 0.0, 0.0
        case Cylinder() | Capsule() | Cone():
            return shape.radius, 0.0, 0.5 * shape.height
        case _:
            return None


def with_corner(obstacle: Obstacle, position: Sequence[float], least: float) -> Obstacle:
    """The obstacle scaled so that its handle is at a place; its centre stays.

    Args:
        obstacle: The obstacle.
        position: Position of the handle in the obstacle's frame, shape (3,) [m].
        least: Size below which nothing is scaled [m].
    """
    x, y, z = (max(abs(float(value)), 0.5 * least) for value in position)
    sizes = {"x": 2.0 * x, "y": 2.0 * y, "z": 2.0 * z, "radius": x, "height": 2.0 * z}
    for name in dimensions(obstacle.shape):
        obstacle = with_dimension(obstacle, name, sizes[name])
    return obstacle


def read_obstacles(file_name: str, content: bytes, frame_pose: _FramePose) -> list[Obstacle]:
    """The obstacles of a file.

    Args:
        file_name: Name whose ending gives the format, and whose stem names the obstacle of a mesh.
        content: Content of the file.
        frame_pose: Answers the pose of a frame that obstacles are in, in the root frame.

    Raises:
        ValueError: The file is of another kind, or can't be read; the message says what to do.
    """
    stem, _, ending = file_name.rpartition(".")
    kind = ending.lower()
    try:
        if kind == "json":
            return listed(Scene.model_validate_json(content), frame_pose)
        if kind in MOVEIT:
            return from_moveit(content, frame_pose)
        if kind in FILE_TYPES:
            return [_mesh(stem, content, kind)]
    except ValueError:
        raise
    except Exception as error:
        # Errors of the application below: their message says where, their hint what to do.
        hint = getattr(error, "hint", None) or ""
        raise ValueError(f"{file_name}: {error} {hint}".strip()) from error
    kinds = ", ".join(("json", *MOVEIT, *FILE_TYPES))
    raise ValueError(f"{file_name}: files of this kind are not read; give one of {kinds}")


def listed(scene: Scene, frame_pose: _FramePose) -> list[Obstacle]:
    """The obstacles of a scene of the API, those of a MoveIt text among them.

    Args:
        scene: The scene.
        frame_pose: Answers the pose of a frame in the root frame.
    """
    if scene.obstacles is None:
        return from_moveit(scene.moveit or "", frame_pose)
    placed = []
    for item in scene.obstacles:
        frame = getattr(item.pose, "frame", None) or scene.frame
        pose = item.pose if frame is None else _in(frame_pose(frame), item.pose)
        placed.append(item.model_copy(update={"pose": pose}))
    return placed


def from_moveit(text: str | bytes, frame_pose: _FramePose) -> list[Obstacle]:
    """The obstacles of a planning scene of MoveIt, an object of several solids as ``id/0``, ...

    Args:
        text: YAML, or a geometry file (.scene).
        frame_pose: Answers the pose of a frame in the root frame.

    Raises:
        ArmwrightError: It is no planning scene, or holds what can't be represented.
    """
    scene = scene_from_moveit(text)
    obstacles = []
    for item in scene.obstacles:
        frame, T = scene.fixed_frames.get(item.frame or "", (item.frame, np.eye(4)))
        for solid in item.solids():
            placed = T @ solid.T_world_obstacle
            pose = _pose(placed[:3, 3], Rotation.from_matrix(placed[:3, :3]))
            if frame is not None:
                pose = _in(frame_pose(frame), pose)
            obstacles.append(
                Obstacle(
                    id=solid.id, shape=_shape(solid.shape), pose=pose, margin=item.margin or None
                )
            )
    return obstacles


def _mesh(name: str, content: bytes, kind: str) -> Obstacle:
    vertices, faces = load_mesh(content, kind)
    size = float(np.ptp(vertices, axis=0).max())
    if size > _LARGEST:
        raise ValueError(
            f"{name}.{kind} is {size:.0f} m large: files are taken in metres. Scale it by 0.001 if "
            "it is in millimetres."
        )
    shape = Mesh(vertices=vertices.tolist(), faces=faces.tolist())
    return Obstacle(id=name, shape=shape, pose=Pose.at(0.0, 0.0, 0.0))


def _shape(shape: Any) -> Shape:
    """A shape of the application as the client has it: the same name, the same fields."""
    name = {"HalfSpace": "Halfspace"}.get(type(shape).__name__, type(shape).__name__)
    values = {
        item.name: value.tolist() if isinstance(value, np.ndarray) else value
        for item in fields(shape)
        for value in (getattr(shape, item.name),)
        if not item.name.startswith("_")
    }
    made: Shape = _SHAPES[name].of(**values)
    return made


def _in(frame: Pose, pose: Any) -> FramedPose:
    """A pose of a frame in the root frame, where the frame's own pose is in it."""
    turn = rotation(frame)
    position = turn.apply(np.array(pose.position, dtype=float)) + np.array(frame.position)
    return _pose(position, turn * rotation(pose))


def _pose(position: Any, turn: Any) -> FramedPose:
    return FramedPose(
        position=[float(value) for value in position], quaternion_xyzw=turn.as_quat().tolist()
    )
