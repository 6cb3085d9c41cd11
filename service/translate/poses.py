"""Wire to domain and back: the only place that knows both."""

import base64
import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from pydantic import BaseModel

from armwright_wire import pose as pose_schema
from armwright_wire.scenes import scene as scene_schema
from kinematics import pose as rotation
from kinematics.arrays import Array
from kinematics.errors import InvalidScene, located
from kinematics.rounding import TOLD, asymmetry, check_rotation
from obstacles.meshes import mesh
from obstacles.projection.projection import without_points
from obstacles.scenes.moveit import scene_from_moveit
from obstacles.scenes.placement import in_frame, with_objects
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes import shape as shapes
from service.fields import shared
from service.translate.contacts import contacts

#: Shapes of the domain whose fields are those of a request.
_SHAPES: dict[Any, Any] = {scene_schema.Halfspace: shapes.HalfSpace} | {
    getattr(scene_schema, kind.__name__): kind
    for kind in (
        *(shapes.Box, shapes.Sphere, shapes.Cylinder, shapes.Capsule),
        *(shapes.Cone, shapes.Convex, shapes.PointCloud),
    )
}


def transform(pose: pose_schema.Pose) -> Array:
    """The 4x4 transform of a pose.

    Raises:
        InvalidPose: The orientation is no rotation.
    """
    matrix = None
    if pose.quaternion_xyzw is not None:
        matrix = rotation.from_quaternion(pose.quaternion_xyzw)
    elif pose.rotation_matrix is not None:
        matrix = rotation.from_matrix(pose.rotation_matrix)
    elif pose.euler_zyz is not None:
        matrix = rotation.from_zyz(pose.euler_zyz)
    elif pose.rpy is not None:
        matrix = rotation.from_rpy(pose.rpy)
    elif pose.axis_angle is not None:
        matrix = rotation.from_axis_angle(pose.axis_angle[:3], pose.axis_angle[3])
    return rotation.transform(matrix, pose.position)


def notes_of(body: BaseModel, more: Iterable[str] = ()) -> dict[str, list[str]]:
    """The notes of an answer on how a request was read; nothing where there is nothing to tell.

    Args:
        body: The request.
        more: Further notes, of the scene for one.
    """
    notes = [*rounding_notes(body), *more]
    return {"notes": notes} if notes else {}


def rounding_notes(body: Any, where: str = "") -> list[str]:
    """Notes on the rotations and inertias of a request that are such within rounding only.

    Args:
        body: The request, or a part of it.
        where: Place in the request.
    """
    notes, waiting = list[str](), [("", where, body)]
    while waiting:
        name, place, value = waiting.pop()
        # Scenes tell theirs themselves: they may be stored ones, too.
        if value is None or isinstance(value, float | str) or name == "scene":
            continue
        if name == "quaternion_xyzw":
            norm = math.hypot(*value)
            if abs(norm - 1.0) > TOLD:
                notes.append(f"{place} has norm {norm:.6g}: it was normalised.")
        elif name == "rotation_matrix":
            error = check_rotation(value)
            if error > TOLD:
                notes.append(
                    f"{place} is a rotation within rounding only, R^T R differs from I by "
                    f"{error:.2g}: the nearest rotation was taken."
                )
        elif name == "inertia" and isinstance(value, list) and isinstance(value[0], list):
            askew = asymmetry(value)
            if askew > TOLD * max(abs(x) for row in value for x in row):
                notes.append(
                    f"{place} is symmetric within rounding only, to {askew:.2g}: its mean with its "
                    "transpose was taken."
                )
        elif isinstance(value, BaseModel | dict):
            parts = vars(value) if isinstance(value, BaseModel) else value
            for part in reversed(parts):
                inside = f"{place}.{part}" if place else part
                waiting.append((part, inside, parts[part]))
        elif isinstance(value, list) and value and isinstance(value[0], BaseModel | dict):
            waiting += [("", f"{place}[{k}]", part) for k, part in enumerate(value)][::-1]
    return notes


def pose_answer(T_base_link: Array) -> pose_schema.PoseAnswer:
    """A 4x4 transform as answers give it."""
    return pose_schema.PoseAnswer(
        position=T_base_link[:3, 3].tolist(),
        quaternion_xyzw=rotation.to_quaternion(T_base_link[:3, :3]).tolist(),
    )


def shape(body: scene_schema.Shape) -> shapes.Shape:
    """The domain's shape. Reads mesh files, so it belongs in a worker.

    Raises:
        InvalidScene: The shape is degenerate, or the mesh file can't be read.
    """
    if isinstance(body, scene_schema.Mesh):
        return _mesh(body)
    kind = _SHAPES[type(body)]
    given = shared(body, kind).items()
    made: shapes.Shape = kind(**{n: np.array(x) if isinstance(x, list) else x for n, x in given})
    return made


def _mesh(body: scene_schema.Mesh) -> shapes.Mesh:
    if body.stl_base64 is not None:
        return shapes.Mesh(*mesh.load_mesh(base64.b64decode(body.stl_base64), "stl"))
    return shapes.Mesh(np.array(body.vertices), np.array(body.faces))


def scene(body: scene_schema.Scene) -> Scene:
    """The domain's scene. Reads mesh files, so it belongs in a worker.

    Raises:
        InvalidScene: A shape or an obstacle is not valid.
        InvalidPose: The pose of an obstacle is not valid.
        InvalidObjectName: A cloud leaves out points of an object that there is not.
    """
    allowed = contacts(body.allowed_collisions, "scene")
    if body.moveit is not None:
        read = scene_from_moveit(body.moveit)
        made = replace(read, contacts={**read.contacts, **allowed}) if allowed else read
    else:
        obstacles = tuple(_obstacle(item) for item in body.obstacles or ())
        named = {name for pair in allowed for name in pair}
        notes = tuple(rounding_notes(body, "scene"))
        made = with_objects(Scene(obstacles, contacts=allowed, notes=notes), named)
        for item in body.obstacles or ():
            for out in getattr(item.shape, "except_", None) or ():
                made = without_points(made, item.id, out.object, out.margin)
    return made if body.frame is None else in_frame(made, body.frame)


def frame_of(pose: pose_schema.Pose) -> str | None:
    """The frame that a pose names, if it is one that may."""
    return pose.frame if isinstance(pose, pose_schema.FramedPose) else None


def _obstacle(item: scene_schema.Obstacle) -> Obstacle:
    with located(f"obstacle {item.id!r}", InvalidScene, unless=repr(item.id)):
        placed = shape(item.shape), transform(item.pose)
        return Obstacle(item.id, *placed, item.margin or 0.0, frame_of(item.pose))
