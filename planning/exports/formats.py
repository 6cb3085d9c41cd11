"""Messages of ROS 2 and tables; and the robots that each format fits."""

import csv
import io
import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain, JointType
from kinematics.trajectory.export import NANOSECONDS
from planning.exports.options import ExportFormat
from planning.exports.points import ExportPoints

_COLUMNS = ("position", "velocity", "acceleration")
_FIELDS = ("positions", "velocities", "accelerations")
#: Joints of a URScript motion, and of the robot's own axes in RAPID and KRL.
ROBOT_AXES = 6
#: Axes beyond the robot's own in RAPID and KRL.
EXTRA_AXES = 6


def table(joint_names: Sequence[str], points: ExportPoints) -> list[str]:
    """Lines of a table with a header; numbers have all their digits.

    Args:
        joint_names: n names.
        points: A row each: time [s], positions, and velocities and accelerations by the rule.
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    kinds = _COLUMNS[: len(points.derivatives)]
    writer.writerow(["time", *(f"{kind}.{name}" for kind in kinds for name in joint_names)])
    rows = np.concatenate([points.times[:, None], *points.derivatives], axis=1)
    writer.writerows([[repr(value) for value in row] for row in rows.tolist()])
    return stream.getvalue().splitlines()


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
    # How late the arm may be at the goal of an action [s].
    return [*lines, f"goal_time_tolerance: {{sec: {1}, nanosec: 0}}"]


def yaml_number(value: float) -> str:
    """A number with all its digits; YAML 1.1 takes one without a point, such as 1e-05, for text."""
    text = repr(float(value))
    mantissa, e, exponent = text.partition("e")
    return f"{mantissa}.0e{exponent}" if e and "." not in mantissa else text


def _numbers(row: Array) -> str:
    return ", ".join(yaml_number(value) for value in np.asarray(row).tolist())


def check_axes(chain: Chain, format_: ExportFormat) -> None:
    """Refuse a robot whose joints a program can't name.

    Raises:
        InvalidOption: It has other joints than the language's motions take.
    """
    programs = (ExportFormat.URSCRIPT_SERVOJ, ExportFormat.URSCRIPT_MOVEJ)
    takes_six = format_ in programs
    if not takes_six and format_ not in (ExportFormat.RAPID, ExportFormat.KRL):
        return
    fits = chain.n == ROBOT_AXES if takes_six else chain.n <= ROBOT_AXES + EXTRA_AXES
    count = "6" if takes_six else f"at most {ROBOT_AXES + EXTRA_AXES}"
    if not fits:
        raise InvalidOption(
            f"format: {format_.value} moves {count} joints, robot {chain.name!r} has {chain.n}",
            hint="Choose joint_trajectory_yaml, ros2_control or csv.",
        )
    slides = np.flatnonzero(np.asarray(chain.joint_types) == JointType.PRISMATIC)
    if len(slides):
        raise InvalidOption(
            f"format: {format_.value} is written for turning joints, "
            f"{chain.joint_names[int(slides[0])]!r} slides",
            hint="Choose joint_trajectory_yaml, ros2_control or csv.",
        )
