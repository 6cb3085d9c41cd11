"""Motions of the tool in time, between wire and domain."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from armwright_wire.goals import tool_motion as cartesian
from kinematics.arrays import Array
from kinematics.errors import InvalidGoal
from kinematics.forward import forward
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from planning.options import ToolMotionOptions
from planning.result import Plan, ToolMotionReport
from planning.tool_motions.timed_tool_motions import SpeedBand, TimedToolMotions
from planning.tool_motions.tool_corner import ToolCorner, ToolCurve
from planning.tool_motions.tool_motion import ToolMotion
from planning.tool_motions.tool_tolerance import ToolTolerance
from planning.tool_paths.planner import tool_motion, tool_reference
from service.fields import listed, picked
from service.translate import poses
from service.translate.seams import tolerance

#: Motions that begin this near to where the one before ends begin there [m and 1].
_SAME_PLACE = 1e-12
#: Sides of corners are longer than this [m].
_SHORTEST_LEG = 1e-9


def timed_tool_motions(
    body: cartesian.TimedToolMotions | None, chain: Chain, motion: Trajectory, begins: float
) -> TimedToolMotions | None:
    """The tool motions that a trajectory is held to, each from where the one before ends.

    Args:
        body: Body as the request gives them, in the root frame.
        chain: The robot; its tip is the tool.
        motion: The trajectory.
        begins: Time of the motion's beginning [s].

    Raises:
        InvalidGoal: A circular motion that names no circle.
        InvalidLinkName: The frame of a tolerance is unknown, or moves.
        InvalidOption: A tolerance is out of its range; the message says of which motion.
    """
    if body is None:
        return None
    first = 0.0 if body.begins is None else body.begins - begins
    ends = [motion.duration] if body.ends is None else [end - begins for end in body.ends]
    times = np.array([first, *ends])
    starts = np.array(
        [
            time if item.begins is None else item.begins - begins
            for item, time in zip(body.motions, times[:-1], strict=True)
        ]
    )
    T_start = forward(chain, motion.sample([min(max(first, 0.0), motion.duration)])[0])
    return TimedToolMotions(
        _curves(T_start, body),
        times,
        body.max_deviation,
        None if body.orientation == "free" else body.max_orientation_deviation,
        _tolerances(body, chain),
        _speed_bands(body, times, starts),
        starts,
    )


def _curves(T_start: Array, body: cartesian.TimedToolMotions) -> tuple[ToolCurve, ...]:
    """The motions from a pose on, each from where the one before ends unless it says so itself."""
    curves: list[ToolCurve] = []
    T = T_start
    for k, item in enumerate(body.motions):
        if item.rounds is None:
            curves.append(tool_motion(T, _motion_options(item), k, body.max_deviation))
        else:
            start = T if item.start is None else poses.transform(item.start)
            curves.append(_corner(start, item, item.rounds, k))
        T = curves[-1].T_end
    return tuple(curves)


def _corner(
    T_start: Array, item: cartesian.TimedToolMotion, corner: cartesian.RoundedCorner, index: int
) -> ToolCorner:
    T_corner, T_end = poses.transform(corner.pose), poses.transform(item.pose)
    legs = []
    for T, T_next, arc in ((T_start, T_corner, corner.before), (T_corner, T_end, corner.after)):
        options = ToolMotionOptions("lin", T_next)
        if arc is not None:
            options = ToolMotionOptions("circ", T_next, center=arc.center, normal=arc.normal)
        leg = tool_motion(T, options, index, 0.0)
        if leg.length < _SHORTEST_LEG:
            raise InvalidGoal(
                f"motions[{index}]: a corner has no length on one of its sides",
                hint="Give the corner that tool_motions of a plan tell.",
                motion=index,
            )
        legs.append(leg)
    return ToolCorner(legs[0], legs[1], corner.slope)


def _motion_options(item: cartesian.TimedToolMotion) -> ToolMotionOptions:
    pose, start = poses.transform(item.pose), None
    if item.start is not None:
        start = poses.transform(item.start)
    assert item.type != "corner"
    return ToolMotionOptions(
        item.type, pose, item.via, item.center, item.normal, None, start, item.rotation == "longer"
    )


def _tolerances(body: cartesian.TimedToolMotions, chain: Chain) -> tuple[ToolTolerance | None, ...]:
    """The box of each motion; None of those that the tool is to follow."""
    common = tolerance(body.tolerance, chain, "tool_motions.tolerance")
    boxes: list[ToolTolerance | None] = []
    for k, item in enumerate(body.motions):
        box = common if item.part == "seam" else None
        if item.tolerance is not None:
            box = tolerance(item.tolerance, chain, f"tool_motions.motions[{k}].tolerance")
        boxes.append(box)
    return tuple(boxes)


def _speed_bands(
    body: cartesian.TimedToolMotions, times: Array, starts: Array
) -> tuple[SpeedBand, ...]:
    """The speeds to be kept, and when."""
    spans = [
        (begins, ends, body.tool_speed if item.tool_speed is None else item.tool_speed)
        for item, begins, ends in zip(
            body.motions, starts.tolist(), times[1:].tolist(), strict=True
        )
        if item.part == "seam"
    ]
    return SpeedBand.of_spans(spans, body.speed_band)


def tool_motions_answer(reports: Sequence[ToolMotionReport]) -> list[dict[str, Any]]:
    """Results of tool motions on the wire."""
    return [
        {
            "type": report.kind,
            **picked(report, "length", "angle", "fraction", "begins", "ends"),
            "rotation": "longer" if getattr(report.motion, "longer", False) else "shorter",
            "motion": report.asked,
            "part": report.part,
            "blend": report.blends,
            "pose": poses.pose_answer(report.motion.T_end).model_dump(),
            "start": _start(report, reports[k - 1] if k > 0 else None),
            **_shape_answer(report.motion),
            "speed_limit": _speed_limit(report),
        }
        for k, report in enumerate(reports)
    ]


def reference_answer(chain: Chain, plan: Plan | None, seed: int) -> list[dict[str, Any]] | None:
    """The reference of a plan's tool motions at drawn instants on the wire; None without any.

    Args:
        chain: The robot; its tip is the tool.
        plan: The plan, if there is one.
        seed: Seed of the draw.
    """
    if plan is None or not plan.tool_motions:
        return None
    return [
        {"time": one.time, "motion": one.motion, "pose": poses.pose_answer(one.T).model_dump()}
        for one in tool_reference(chain, plan.trajectory, plan.tool_motions, seed)
    ]


def _start(report: ToolMotionReport, before: ToolMotionReport | None) -> dict[str, Any] | None:
    """The pose where a motion begins; None where the one before ends."""
    T = report.motion.T_start
    if before is not None and np.abs(before.motion.T_end - T).max() <= _SAME_PLACE:
        return None
    return poses.pose_answer(T).model_dump()


def _shape_answer(motion: ToolCurve) -> dict[str, Any]:
    """Centre and normal of an arc on the wire, the corner that is rounded; nothing of a line."""
    if not isinstance(motion, ToolCorner):
        return {"center": None, "normal": None, "rounds": None} | (_arc_answer(motion) or {})
    corner = {
        "pose": poses.pose_answer(motion.T_corner).model_dump(),
        "slope": motion.slope,
        "before": _arc_answer(motion.first),
        "after": _arc_answer(motion.second),
    }
    return {"center": None, "normal": None, "rounds": corner}


def _arc_answer(motion: ToolMotion) -> dict[str, Any] | None:
    if motion.kind == "lin":
        return None
    return listed(motion, "center", "normal")


def _speed_limit(report: ToolMotionReport) -> dict[str, Any] | None:
    limit = report.speed_limit
    return None if limit is None else picked(limit, "speed", "joint", "quantity")
