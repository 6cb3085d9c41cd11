"""Seams from wire to domain: poses of waypoints, axes of tolerances."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from armwright_wire.goals import tool_motion as schema
from armwright_wire.goals.tool_motion import CartesianOptions
from kinematics.arrays import Array
from kinematics.errors import InvalidGoal, InvalidOption, located
from kinematics.model.chain import Chain
from kinematics.pose import transform
from kinematics.root_frame import TOOL, frame_pose
from planning.tool_motions.tool_tolerance import (
    AXES,
    MAX_POSITION,
    ROTATIONS,
    Axis,
    SeamOptions,
    SeamWaypoint,
    StraightOffset,
    ToolTolerance,
)
from service.translate import poses

#: A direction must be this much across the normal for it to turn the tool [-].
_ACROSS = 1e-6


def seam_options(given: CartesianOptions, chain: Chain) -> SeamOptions:
    """The seam that options of the planner "cartesian" name.

    Args:
        given: Options with waypoints, in the root frame.
        chain: The robot, for frames of tolerances.

    Raises:
        InvalidGoal: A waypoint names no orientation.
        InvalidLinkName: The frame of a tolerance is unknown, or moves.
        InvalidOption: A tolerance is out of its range; the message names the waypoint.
    """
    assert given.waypoints is not None
    where = "planner_options"
    common = tolerance(given.tolerance, chain, f"{where}.tolerance")
    places = [_place(item) for item in given.waypoints]
    return SeamOptions(
        tuple(_waypoint(k, item, places, common, chain) for k, item in enumerate(given.waypoints)),
        common,
        given.tool_speed,
        given.speed_band,
        _offset(given.approach),
        _offset(given.retreat),
        _offset(given.branch_changes),
        given.through or "polyline",
    )


def _place(item: schema.Waypoint) -> Array:
    return np.array(item.point if item.pose is None else item.pose.position)


def _waypoint(
    k: int, item: schema.Waypoint, places: Sequence[Array], common: ToolTolerance, chain: Chain
) -> SeamWaypoint:
    where = f"planner_options.waypoints[{k}]"
    box = None
    if item.tolerance is not None:
        box = tolerance(item.tolerance, chain, f"{where}.tolerance")
    if item.pose is not None:
        T = poses.transform(item.pose)
    else:
        along = places[min(k + 1, len(places) - 1)] - places[max(min(k, len(places) - 2), 0)]
        T = _on_surface(item, along, where)
    axis_only = item.point is not None and item.direction is None
    free = {*item.free, "rz"} if axis_only else item.free
    if free:
        box = _freed(box or common, free, where)
    via = None if item.via is None else np.array(item.via)
    return SeamWaypoint(T, via, box, item.blend, item.tool_speed, axis_only)


def _on_surface(item: schema.Waypoint, along: Array, where: str) -> Array:
    """The pose whose z axis is against the normal, with x along a direction across it."""
    normal = np.array(item.normal, dtype=np.float64)
    z = -normal / np.linalg.norm(normal)
    x = np.array(item.direction, dtype=np.float64) if item.direction is not None else along
    across = x - (x @ z) * z
    if np.linalg.norm(across) <= _ACROSS * max(float(np.linalg.norm(x)), 1e-12):
        if item.direction is not None:
            raise InvalidGoal(
                f"{where}: direction is along the normal",
                hint="Give a direction across it, or leave it out.",
            )
        across = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    x = across / np.linalg.norm(across)
    return np.asarray(transform(np.column_stack([x, np.cross(z, x), z]), _place(item)))


def _freed(box: ToolTolerance, axes: Collection[str], where: str) -> ToolTolerance:
    """A tolerance of which some axes are free: rotations by any angle, positions by the most."""
    lower, upper = box.lower.copy(), box.upper.copy()
    for k, axis in enumerate(AXES):
        if axis in axes:
            most = np.inf if axis in ROTATIONS else MAX_POSITION
            lower[k], upper[k] = -most, most
    with located(f"{where}.free", InvalidOption):
        return replace(box, lower=lower, upper=upper)


def tolerance(given: schema.ToolTolerance | None, chain: Chain, where: str) -> ToolTolerance:
    """A tolerance as the domain has it; exact for none.

    Args:
        given: Tolerance as the request gives it.
        chain: The robot, for its frame.
        where: Name of the field.

    Raises:
        InvalidLinkName: The frame is unknown, or moves.
        InvalidOption: It is out of its range.
    """
    if given is None:
        return ToolTolerance.of({})
    axes = None
    if given.frame not in (None, TOOL):
        assert given.frame is not None
        axes = frame_pose(chain, given.frame, None, f"{where}.frame")[:3, :3]
    names: tuple[Axis, ...] = ("x", "y", "z", "rx", "ry", "rz")
    ranges = {name: tuple(getattr(given, name)) for name in names if getattr(given, name)}
    with located(where, InvalidOption):
        return ToolTolerance.of(ranges, tuple(given.free), given.tilt, axes)


def _offset(given: schema.StraightOffset | None) -> StraightOffset | None:
    if given is None:
        return None
    return StraightOffset(np.array(given.direction), given.distance, given.frame)
