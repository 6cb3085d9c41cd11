"""Motions of the tool in time, between wire and domain."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Chain
from kinematics.forward import forward
from kinematics.trajectory import Trajectory
from planning.cartesian.motions import tool_motions
from planning.options import CartesianOptions, ToolMotionOptions
from planning.result import ToolMotionReport
from planning.tool_motion import SpeedBand, TimedToolMotions, ToolMotion
from planning.tool_tolerance import ToolTolerance
from service.schemas import cartesian
from service.translate import poses
from service.translate.seams import tolerance

#: Motions that begin this near to where the one before ends begin there [m and 1].
_SAME_PLACE = 1e-12


def timed_tool_motions(
    body: cartesian.TimedToolMotions | None, chain: Chain, motion: Trajectory, begins: float
) -> TimedToolMotions | None:
    """The tool motions that a trajectory is held to, each from where the one before ends.

    Args:
        body: As the request gives them, in the root frame.
        chain: The robot; its tip is the tool.
        motion: The trajectory.
        begins: When it begins [s].

    Raises:
        InvalidGoal: A circular motion that names no circle.
        InvalidLinkName: The frame of a tolerance is unknown, or moves.
        InvalidOption: A tolerance is out of its range; the message says of which motion.
    """
    if body is None:
        return None
    asked = CartesianOptions(
        tuple(_motion_options(item) for item in body.motions),
        body.max_deviation,
        body.max_orientation_deviation,
    )
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
        tool_motions(T_start, asked),
        times,
        body.max_deviation,
        None if body.orientation == "free" else body.max_orientation_deviation,
        _tolerances(body, chain),
        _speed_bands(body, times, starts),
        starts,
    )


def _motion_options(item: cartesian.TimedToolMotion) -> ToolMotionOptions:
    pose, start = poses.transform(item.pose), None
    if item.start is not None:
        start = poses.transform(item.start)
    return ToolMotionOptions(
        item.type, pose, item.via, item.center, item.normal, T_base_start=start
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
            "length": report.length,
            "angle": report.angle,
            "fraction": report.fraction,
            "begins": report.begins,
            "ends": report.ends,
            "motion": report.asked,
            "part": report.part,
            "blend": report.blends,
            "pose": poses.pose_answer(report.motion.T_end).model_dump(),
            "start": _start(report, reports[k - 1] if k > 0 else None),
            **_arc_answer(report.motion),
        }
        for k, report in enumerate(reports)
    ]


def _start(report: ToolMotionReport, before: ToolMotionReport | None) -> dict[str, Any] | None:
    """The pose where a motion begins; None where the one before ends."""
    T = report.motion.T_start
    if before is not None and np.abs(before.motion.T_end - T).max() <= _SAME_PLACE:
        return None
    return poses.pose_answer(T).model_dump()


def _arc_answer(motion: ToolMotion) -> dict[str, Any]:
    """Centre and normal of an arc on the wire; nothing of a line."""
    if motion.kind == "lin":
        return {"center": None, "normal": None}
    return {"center": motion.center.tolist(), "normal": motion.normal.tolist()}
