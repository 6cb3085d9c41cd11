"""trajectory_msgs/JointTrajectory and a FollowJointTrajectory goal of ROS 2, as JSON and YAML."""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.trajectory.export import NANOSECONDS
from planning.exports.points import ExportPoints

#: How late the arm may be at the goal of an action [s].
_GOAL_TIME_TOLERANCE = 1
_FIELDS = ("positions", "velocities", "accelerations")


def message_json(joint_names: Sequence[str], points: ExportPoints, frame_id: str) -> str:
    """A JointTrajectory in JSON, which has no comments.

    Args:
        joint_names: n names.
        points: Points with what the controller interpolates by.
        frame_id: Frame id of the header.
    """
    rows = []
    for i, tick in enumerate(points.ticks.tolist()):
        row: dict[str, Any] = {name: [] for name in (*_FIELDS, "effort")}
        row |= {name: d[i].tolist() for name, d in zip(_FIELDS, points.derivatives, strict=False)}
        stamp = {"sec": tick // NANOSECONDS, "nanosec": tick % NANOSECONDS}
        rows.append(row | {"time_from_start": stamp})
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame_id}
    message = {"header": header, "joint_names": list(joint_names), "points": rows}
    return json.dumps(message) + "\n"


def message_yaml(joint_names: Sequence[str], points: ExportPoints, frame_id: str) -> list[str]:
    """Lines of a JointTrajectory in YAML.

    Args:
        joint_names: n names.
        points: Points with what the controller interpolates by.
        frame_id: Frame id of the header.
    """
    lines = [
        "header:",
        "  stamp: {sec: 0, nanosec: 0}",
        f"  frame_id: {json.dumps(frame_id)}",
        f"joint_names: [{', '.join(json.dumps(name) for name in joint_names)}]",
        "points:",
    ]
    for i, tick in enumerate(points.ticks.tolist()):
        seconds, nanoseconds = divmod(tick, NANOSECONDS)
        lines.append(f"- time_from_start: {{sec: {seconds}, nanosec: {nanoseconds}}}")
        lines += [
            f"  {name}: [{_numbers(d[i])}]"
            for name, d in zip(_FIELDS, points.derivatives, strict=False)
        ]
    return lines


def goal_yaml(
    joint_names: Sequence[str], points: ExportPoints, frame_id: str, tolerance: float | None
) -> list[str]:
    """Lines of a control_msgs/action/FollowJointTrajectory goal in YAML.

    Args:
        joint_names: n names.
        points: Points with what the controller interpolates by.
        frame_id: Frame id of the header.
        tolerance: Tracking error at which the controller stops the arm [rad or m]; None sends
            no tolerances, so that the controller's own hold.
    """
    message = message_yaml(joint_names, points, frame_id)
    lines = ["trajectory:", *(f"  {line}" for line in message)]
    for field in ("path_tolerance", "goal_tolerance"):
        if tolerance is None:
            lines.append(f"{field}: []")
            continue
        lines.append(f"{field}:")
        lines += [
            f"- {{name: {json.dumps(name)}, position: {yaml_number(tolerance)}, "
            "velocity: 0.0, acceleration: 0.0}"
            for name in joint_names
        ]
    return [*lines, f"goal_time_tolerance: {{sec: {_GOAL_TIME_TOLERANCE}, nanosec: 0}}"]


def yaml_number(value: float) -> str:
    """A number with all its digits; YAML 1.1 takes one without a point, such as 1e-05, for text."""
    text = repr(float(value))
    mantissa, e, exponent = text.partition("e")
    return f"{mantissa}.0e{exponent}" if e and "." not in mantissa else text


def _numbers(row: Array) -> str:
    return ", ".join(yaml_number(value) for value in np.asarray(row).tolist())
