"""Reach and base placement as requests ask for them, in workers."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pydantic_core import to_json

from armwright_wire.pose import Pose
from armwright_wire.robots.reach import JOINTS_UP_TO, MAX_BASES, BaseRegion, ReachRequest
from kinematics import pose as rotation
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.root_frame import frame_pose
from obstacles.convex.triangles import Triangles
from obstacles.meshes.writer import glb
from planning.reach import evaluation
from planning.reach.base_placement import BasePlacement, place_base
from planning.reach.evaluation import (
    PoseGrid,
    Reach,
    ReachOptions,
    Status,
)
from service.endpoints.attached_objects import RobotInScene, robot_in_scene
from service.endpoints.reach import picture
from service.endpoints.reach.picture import HIGH, LOW
from service.endpoints.tasks.translation import reach_tolerance
from service.fields import listed
from service.storage.caches.cache_key import Reference
from service.translate import poses
from service.workers import current
from service.workers.answer import in_frame
from service.workers.result import TaskProblem
from service.workers.task import GRACE, task

#: Corners of a cube's face at the upper end of an axis, in units of its half edges: along the next
#: axis and the one after, counter-clockwise from outside.
_CORNERS = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])


def draw(grid: PoseGrid, found: Reach) -> bytes:
    """A GLB of a grid: a cube at each point that is reached, without the faces between two of them.

    Cubes go from blue at the least manipulability to yellow at the largest, and are as large as the
    spacing; along an edge of the box without length they are as thick.

    Args:
        grid: Points with one orientation, one of them at least reached.
        found: Reach of the points.
    """
    shape = grid.shape[:3]
    reached = found.status.reshape(shape) == Status.REACHED.value
    figure = found.manipulability.reshape(shape)
    share = np.where(reached, figure, 0.0) / max(float(figure[reached].max()), 1e-12)
    padded = np.pad(reached, 1)
    edges = [edge / (count - 1) if count > 1 else grid.spacing
             for edge, count in zip(grid.size, shape, strict=True)]  # fmt: skip
    centres = np.stack(np.meshgrid(*grid.axes(), indexing="ij"), axis=-1)
    corners, shares = [], []
    for axis in range(3):
        for side in (1, -1):
            beside = np.roll(padded, -side, axis)[1:-1, 1:-1, 1:-1]
            bare = reached & ~beside
            corners.append(centres[bare][:, None] + 0.5 * _face(axis, side) * edges)
            shares.append(share[bare])
    points = np.concatenate(corners).reshape(-1, 3)
    points = points @ grid.T_base_box[:3, :3].T + grid.T_base_box[:3, 3]
    first = 4 * np.arange(len(points) // 4)[:, None]
    faces = np.concatenate(
        [first + np.array(corner) for corner in ((0, 1, 2), (0, 2, 3))], axis=1
    ).reshape(-1, 3)
    colours = LOW + np.repeat(np.concatenate(shares), 4)[:, None] * (HIGH - LOW)
    opaque = np.column_stack([colours, np.full(len(colours), 255.0)])
    return glb(Triangles(points, faces), "reach", opaque.astype(np.uint8))


def _face(axis: int, side: int) -> Array:
    """Corners of a cube's face, counter-clockwise from outside, shape (4, 3)."""
    corners = np.empty((4, 3))
    corners[:, axis] = side
    corners[:, (axis + 1) % 3], corners[:, (axis + 2) % 3] = _CORNERS[::side].T
    return corners


#: Poses times candidates for the base of one request.
_MAX_CHECKS = 2_000_000
#: Numbers of unreached poses that are told of each candidate.
_MAX_UNREACHED = 100
#: Figures are rounded to a millionth [m]: seventeen digits would triple the answer.
_DIGITS = 6


@task(grace=GRACE)
def reach(robot: Reference, scene: Reference | None, content: bytes) -> bytes | TaskProblem:
    """Answer a request for the reach of an arm.

    Raises:
        InvalidPose: An orientation is no rotation.
        InvalidScene: The inline scene or an attached object is not valid.
        InvalidLinkName: No such link.
        InvalidOption: The grid, the tolerance or the candidates have no sense or are too many.
    """
    body = ReachRequest.model_validate_json(content)
    cell = robot_in_scene(robot, scene, body)
    arm = cell.robot
    if body.link is not None and body.link not in arm.chain.index:
        arm = replace(arm, chain=cell.chain)
    link = arm.chain.link(body.link or arm.chain.tip_link).name
    grid = None if body.box is None else _grid(body)
    if body.format != "json" and (grid is None or grid.shape[3] != 1):
        raise InvalidOption("a picture shows one orientation", hint='Ask for "format": "json".')
    tasks = _transforms(body.poses or ()) if grid is None else grid.poses()
    options = ReachOptions(
        reach_tolerance(body.tolerance),
        body.margin,
        body.choice,
        body.clearance,
        body.seed,
        threads=1,
    )
    if body.frame is not None:
        tasks = frame_pose(cell.robot.chain, body.frame, None, "frame") @ tasks
    candidates = _bases(body)
    placements: list[BasePlacement] | None = None
    if candidates is None:
        found = evaluation.reach(
            arm, cell.scene, tasks, options,
            link=link, deadline=current.deadline(), report=_report,
        )  # fmt: skip
    else:
        _check_size(len(tasks), len(candidates))
        placements = place_base(
            arm, cell.scene, tasks, candidates, options,
            link=link, deadline=current.deadline(), report=_report,
        )  # fmt: skip
        if len(placements) < len(candidates):
            return _timed_out(len(placements), len(candidates), "candidates for the base")
        found = placements[0].reach
    if found.completed < len(tasks):
        return _timed_out(found.completed, len(tasks), "poses")
    if grid is not None and body.format == "svg":
        return picture.draw(grid, found).encode()
    if grid is not None and body.format == "glb":
        if not found.is_reached.any():
            raise InvalidOption(
                "no point of the box is reached: there is no mesh of it",
                hint='Move the box, or ask for "format": "json" to see why.',
            )
        return draw(grid, found)
    return to_json(_answer(found, body, cell, grid, placements), inf_nan_mode="null")


def _report(share: float) -> None:
    current.report(share, "reach")


def _transforms(given: Sequence[Pose]) -> Array:
    return np.array([poses.transform(pose) for pose in given])


def _grid(body: ReachRequest) -> PoseGrid:
    box = body.box
    assert box is not None
    rotations = np.array([rotation.from_quaternion(item) for item in box.orientations])
    return PoseGrid(np.array(box.size), box.spacing, poses.transform(box.pose), rotations)


def _bases(body: ReachRequest) -> Array | None:
    """T_world_base of the candidates, shape (b, 4, 4)."""
    if body.bases is not None:
        return _transforms(body.bases)
    return None if body.base_region is None else _region(body.base_region)


def _region(region: BaseRegion) -> Array:
    rows = [_line(low, high, region.spacing) for low, high in (region.x, region.y)]
    yaws = np.arange(region.yaws) * 2.0 * np.pi / region.yaws
    count = len(rows[0]) * len(rows[1]) * len(yaws)
    if count > MAX_BASES:
        raise InvalidOption(
            f"base_region has {count} candidates, at most {MAX_BASES} are looked at",
            hint="Take a wider spacing or fewer yaws.",
        )
    return np.array(
        [
            rotation.transform(rotation.rotation_z(yaw), [x, y, region.z])
            for x in rows[0]
            for y in rows[1]
            for yaw in yaws
        ]
    )


def _line(low: float, high: float, spacing: float) -> Array:
    if low > high:
        raise InvalidOption(f"base_region: {low:g} m is above {high:g} m")
    steps = min(np.ceil((high - low) / spacing - 1e-9), 10.0 * MAX_BASES)
    return np.linspace(low, high, int(steps) + 1)


def _check_size(tasks: int, candidates: int) -> None:
    if tasks * candidates > _MAX_CHECKS:
        raise InvalidOption(
            f"{tasks} poses and {candidates} candidates for the base make {tasks * candidates} "
            f"checks, at most {_MAX_CHECKS} are done at once",
            hint="Ask for fewer poses or candidates.",
        )


def _timed_out(done: int, count: int, what: str) -> TaskProblem:
    return TaskProblem(
        "TIMED_OUT",
        f"the deadline passed after {done} of {count} {what}",
        "Allow more time with the field timeout, or ask for fewer.",
        {"stage": "reach", "completed": done},
    )


def _answer(
    found: Reach,
    body: ReachRequest,
    cell: RobotInScene,
    grid: PoseGrid | None,
    placements: list[BasePlacement] | None,
) -> dict[str, Any]:
    with_joints = found.completed <= JOINTS_UP_TO if body.joints is None else body.joints
    rows = zip(found.joints.tolist(), found.is_reached.tolist(), strict=True)
    return {
        **in_frame(cell.robot.chain, body.frame if placements is None else "world"),
        "count": found.completed,
        "reached": int(found.is_reached.sum()),
        "statuses": [status.name.lower() for status in Status],
        **listed(found, "status", "branches", "samples"),
        "manipulability": found.manipulability.round(_DIGITS).tolist(),
        "clearance": found.clearance.round(_DIGITS).tolist(),
        "limit_distance": found.limit_distance.round(_DIGITS).tolist(),
        "joints": [q if reached else None for q, reached in rows] if with_joints else None,
        "joint_names": list(cell.robot.chain.joint_names),
        "grid": None
        if grid is None
        else {"shape": list(grid.shape), "axes": [axis.tolist() for axis in grid.axes()]},
        "bases": None if placements is None else [_base_answer(item) for item in placements],
        "allowed_collisions": cell.pairs,
        **poses.notes_of(body, cell.notes),
    }


def _base_answer(placement: BasePlacement) -> dict[str, Any]:
    clearance, manipulability, limit_distance = placement.worst
    missed = np.flatnonzero(~placement.reach.is_reached)
    return {
        "index": placement.index,
        "pose": poses.pose_answer(placement.T_world_base).model_dump(),
        "reached": int(placement.reach.is_reached.sum()),
        "clearance": clearance,
        "manipulability": manipulability,
        "limit_distance": limit_distance,
        "unreached": missed[:_MAX_UNREACHED].tolist(),
    }
