"""Requests of the studio's state, uploads of robots, and the obstacles of the scene editor.

Files are robots, scenes in JSON, planning scenes of MoveIt, and meshes. The readers are the
application's own, so that a file means here what it means to the service.
"""

import io
import json
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal
from zipfile import ZipFile, is_zipfile

import numpy as np
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from armwright_client import (
    ApiError,
    ArmwrightError,
    Attached,
    Box,
    Capsule,
    Clearance,
    Client,
    Cone,
    Convex,
    Cylinder,
    DefaultLimits,
    FramedPose,
    Goal,
    Halfspace,
    IkRequest,
    Mesh,
    Obstacle,
    PlanRequest,
    PointCloud,
    Pose,
    RobotArchive,
    RobotOptions,
    RobotUpload,
    Scene,
    Sphere,
    Start,
    TaskRequest,
    Timing,
    TourRequest,
)
from armwright_wire.scenes.scene import Shape
from obstacles.meshes.mesh import FILE_TYPES, load_mesh
from obstacles.scenes.moveit import scene_from_moveit
from studio.pose import rotation
from studio.state import Failure, Outcome, Planned, StudioState, TaskPlanned, TourPlanned, failure

#: URDF knows no accelerations: without a rule no uploaded robot could be planned for.
_RULES = DefaultLimits(acceleration="10 x velocity")
#: Largest size of an archive that is unpacked here [byte].
_MOST_UNPACKED = 512 * 2**20
#: Inverse kinematics while a goal is dragged may take this long [s].
_LIVE_TIMEOUT = 2.0
#: Solutions that are drawn at once; more would hide each other.
MAX_BRANCHES = 8
#: Settings of a plan that a task takes as well.
_OF_TASKS = ("margin", "seed", "timeout", "timing")
#: And a tour.
_OF_TOURS = (*_OF_TASKS, "clearance")
#: Goals of a tour and waypoints of a tool path at least.
_FEWEST = 2
#: Models of the settings that are objects.
_MODELS = {"timing": Timing, "clearance": Clearance}


def scene_of(state: StudioState) -> Scene | None:
    """The scene of a state; None where there are no obstacles."""
    return Scene(obstacles=list(state.obstacles)) if state.obstacles else None


def goal_of(state: StudioState) -> Goal:
    """The goal of a state: a pose, or a configuration."""
    if state.goal_pose is not None:
        return Goal(pose=state.goal_pose)
    return Goal(joints=state.goal_joints)


def plan_request(state: StudioState, *, keep: bool = True) -> PlanRequest:
    """The request that plans from start to goal.

    Args:
        state: State of the studio.
        keep: Whether the service keeps request and answer, for the page that shows them.

    Raises:
        pydantic.ValidationError: A setting is out of its range.
    """
    return PlanRequest(
        **_common(state, keep),
        robot=state.robot,
        goal=goal_of(state),
        fingers=dict(state.fingers) or None,
        constraints=[dict(entry) for entry in state.constraints] or None,
    )


def task_request(state: StudioState, *, keep: bool = True) -> TaskRequest:
    """The request that plans the stages of the task as one, from the start on.

    Args:
        state: State of the studio.
        keep: Whether the service keeps request and answer, for the page that shows them.

    Raises:
        pydantic.ValidationError: A stage or a setting is not as the API has it.
    """
    # Read from JSON: of what kind a stage is, and that its fields are right, the model finds out.
    stages = [dict(entry) for entry in state.stages]
    read = TaskRequest.model_validate_json(
        json.dumps({"robot": state.robot, "start": {"joints": [*state.start]}, "stages": stages})
    )
    return TaskRequest(
        **_common(state, keep, _OF_TASKS),
        robot=state.robot,
        stages=read.stages,
        fingers=dict(state.fingers) or None,
    )


def tour_request(state: StudioState, *, keep: bool = True) -> TourRequest:
    """The request for the goals of the tour in the best order, from the start on.

    Args:
        state: State of the studio.
        keep: Whether the service keeps request and answer, for the page that shows them.

    Raises:
        pydantic.ValidationError: A goal or a setting is not as the API has it.
        ValueError: There are no two goals.
    """
    if len(state.goals) < _FEWEST:
        raise ValueError("a tour has two goals or more: add them first")
    body = {"robot": state.robot, "goals": [dict(entry) for entry in state.goals]}
    read = TourRequest.model_validate_json(json.dumps({**body, **state.tour_options}))
    return TourRequest(**set_fields(read), **_common(state, keep, _OF_TOURS))


def path_request(state: StudioState, *, keep: bool = True) -> PlanRequest:
    """The request for a motion of the tool along the waypoints, from the start on.

    Args:
        state: State of the studio.
        keep: Whether the service keeps request and answer, for the page that shows them.

    Raises:
        pydantic.ValidationError: A waypoint or a setting is not as the API has it.
        ValueError: There are no two waypoints.
    """
    if len(state.waypoints) < _FEWEST:
        raise ValueError("a tool path has two waypoints or more: add them first")
    last = state.waypoints[-1]
    pose = last.get("pose") or {"position": last.get("point")}
    goal = Goal.model_validate_json(json.dumps({"pose": pose}))
    request = plan_request(state, keep=keep)
    options = {"waypoints": [dict(entry) for entry in state.waypoints], **state.path_options}
    changes = {"goal": goal, "planner": "cartesian", "planner_options": options}
    return request.model_copy(update=changes)


def set_fields(request: Any, without: Sequence[str] = ()) -> dict[str, Any]:
    """Fields of a request that are set, as the client's methods take them.

    Args:
        request: A model of the client.
        without: Fields that the method takes by position.
    """
    return {
        name: getattr(request, name)
        for name in type(request).model_fields
        if name in request.model_fields_set
        and name not in without
        and getattr(request, name) is not None
    }


def ik_request(state: StudioState, pose: Pose) -> IkRequest:
    """The request for all configurations that reach a pose, valid or not.

    Args:
        state: State of the studio.
        pose: Pose of the tip, in the root frame.
    """
    return IkRequest(
        pose=pose,
        tool=state.tool,
        seed_joints=state.goal_joints,
        all_solutions=True,
        max_solutions=MAX_BRANCHES,
        scene=scene_of(state),
        attached=_attached(state),
        timeout=_LIVE_TIMEOUT,
    )


def _common(
    state: StudioState, keep: bool, settings: Sequence[str] | None = None
) -> dict[str, Any]:
    """Fields that all requests for motions have: tool, start, surroundings and settings.

    Args:
        state: State of the studio.
        keep: Whether the service keeps request and answer.
        settings: Settings that the request takes, by the first word of their path; None for all.
    """
    taken = {
        path: value
        for path, value in state.settings.items()
        if settings is None or path.partition(".")[0] in settings
    }
    return {
        "tool": state.tool,
        "start": Start(joints=state.start),
        "scene": scene_of(state),
        "attached": _attached(state),
        "keep": keep or None,
        **_nested(taken),
    }


def _attached(state: StudioState) -> list[Attached] | None:
    """Obstacles that are carried from the start, where the link has closed on them."""
    carried = [
        Attached(id=name, link=link, grasp_joints=state.start, touch_links=[link])
        for name, link in state.attached.items()
    ]
    return carried or None


def _nested(settings: Any) -> dict[str, Any]:
    """Settings by path as fields, objects as models."""
    fields: dict[str, Any] = {}
    groups: dict[str, dict[str, Any]] = {}
    for path, value in settings.items():
        group, _, name = path.partition(".")
        if name:
            groups.setdefault(group, {})[name] = value
        else:
            fields[path] = value
    return fields | {group: _MODELS[group](**values) for group, values in groups.items()}


def attempt(state: StudioState, action: Callable[[], Outcome]) -> Outcome:
    """The result of a question, or why there is none.

    Args:
        state: State that is asked about.
        action: Asks.
    """
    try:
        return action()
    except ApiError as error:
        return failure(state, error.problem)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(step) for step in first["loc"])
        title = "A field is missing or out of its range"
        return Failure(state, title, f"{where}: {first['msg']}")
    except ValueError as error:
        return Failure(state, "Something is missing", str(error))
    except ArmwrightError as error:
        return Failure(state, "The service did not answer", str(error))


def plan(client: Client, state: StudioState, kind: str) -> Outcome:
    """What was asked for, planned by the service.

    Args:
        client: Client that asks the service.
        state: State of the studio.
        kind: "motion", "task", "tour" or "tool path".

    Raises:
        ApiError: There is no such motion.
        ValueError: There are no two goals of the tour, or waypoints of the tool path.
    """
    if kind == "task":
        task = task_request(state)
        options = set_fields(task, without=("robot", "start", "stages"))
        return TaskPlanned(state, client.plan_task(task.robot, task.start, task.stages, **options))
    if kind == "tour":
        tour = tour_request(state)
        options = set_fields(tour, without=("robot", "goals"))
        return TourPlanned(state, client.plan_tour(tour.robot, tour.goals, **options))
    motion = path_request(state) if kind == "tool path" else plan_request(state)
    options = set_fields(motion, without=("robot", "start", "goal"))
    return Planned(state, client.plan(motion.robot, motion.start, motion.goal, **options))


ShapeKind = Literal["box", "sphere", "cylinder"]
#: Edge, diameter and height of a new obstacle [m]: a box that a gripper holds.
NEW_SIZE = 0.1
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
    kind: ShapeKind, obstacle_id: str, position: tuple[float, float, float], size: float = NEW_SIZE
) -> Obstacle:
    """A new obstacle of the usual size.

    Args:
        kind: Kind of the shape.
        obstacle_id: Id of the obstacle.
        position: Position of the centre in the root frame [m].
        size: Edge, diameter and height [m].
    """
    shapes: dict[ShapeKind, Shape] = {
        "box": Box(size=[size, size, size]),
        "sphere": Sphere(radius=0.5 * size),
        "cylinder": Cylinder(radius=0.5 * size, height=size),
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


def robot_upload(
    file_name: str, content: bytes, tip_link: str | None
) -> RobotUpload | RobotArchive:
    """The upload of a URDF, a xacro or MJCF file, or a .zip with one of them and its meshes.

    xacro and MJCF become URDF here, in the studio's own process, and never in the service.

    Args:
        file_name: Name whose stem becomes the robot's name.
        content: Content of the file.
        tip_link: Link that the chain ends at, for a tree with several arms.

    Raises:
        ValueError: The file is of another kind, or can't be expanded.
    """
    stem, _, suffix = file_name.rpartition(".")
    options: RobotOptions = {"default_limits": _RULES}
    if tip_link is not None:
        options["tip_link"] = tip_link
    is_model = suffix.lower() == "xml" and b"<mujoco" in content
    if suffix.lower() in ("urdf", "xml") and not is_model:
        return RobotUpload(name=stem, urdf=content.decode("utf-8"), **options)
    if suffix.lower() not in ("zip", "xacro") and not is_model:
        raise ValueError(f"{file_name}: give a .urdf, .xacro or MJCF, or a .zip with its meshes")
    stem = stem.removesuffix(".urdf")
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"robot.{suffix.lower()}"
        if suffix.lower() != "zip":
            path.write_bytes(content)
        elif _unpacked(file_name, content, folder):
            path = Path(folder)
        else:
            return RobotArchive(stem, content, options)
        return RobotUpload.from_urdf(path, name=stem, **options)


def _unpacked(file_name: str, content: bytes, folder: str) -> bool:
    """Unpack an archive that has a .xacro or .xml and no .urdf; whether it is one."""
    if not is_zipfile(io.BytesIO(content)):
        return False
    with ZipFile(io.BytesIO(content)) as archive:
        suffixes = {Path(name).suffix.lower() for name in archive.namelist()}
        if ".urdf" in suffixes or suffixes.isdisjoint((".xacro", ".xml")):
            return False
        if sum(item.file_size for item in archive.infolist()) > _MOST_UNPACKED:
            raise ValueError(f"{file_name} unpacks to more than {_MOST_UNPACKED >> 20} MiB")
        archive.extractall(folder)
    return True
