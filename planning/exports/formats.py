"""Messages and programs of ROS 2 and tables; and the robots that each format fits."""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain, JointType
from kinematics.trajectory.export import NANOSECONDS
from planning.exports.languages import Language, WrittenMotion
from planning.exports.options import Event, ExportFormat, ExportOptions
from planning.exports.points import ExportPoints

_COLUMNS = ("position", "velocity", "acceleration")
_FIELDS = ("positions", "velocities", "accelerations")


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
    for name in ("path_tolerance", "goal_tolerance"):
        if tolerance is None:
            lines.append(f"{name}: []")
            continue
        lines.append(f"{name}:")
        lines += [
            f"- {{name: {json.dumps(joint)}, position: {yaml_number(tolerance)}, "
            "velocity: 0.0, acceleration: 0.0}"
            for joint in joint_names
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


def check_axes(chain: Chain, options: ExportOptions) -> None:
    """Refuse a robot whose joints a program can't name.

    Raises:
        InvalidOption: It has other joints than the language's motions take.
    """
    takes, name = options.traits.joints, options.format.value
    if takes is None:
        return
    other = "Choose joint_trajectory_yaml, ros2_control or csv."
    if chain.n not in takes:
        count = str(takes[0]) if len(takes) == 1 else f"at most {takes[-1]}"
        message = f"format: {name} moves {count} joints, robot {chain.name!r} has {chain.n}"
        raise InvalidOption(message, hint=other)
    slides = np.flatnonzero(np.asarray(chain.joint_types) == JointType.PRISMATIC)
    if len(slides):
        slide = chain.joint_names[int(slides[0])]
        message = f"format: {name} is written for turning joints, {slide!r} slides"
        raise InvalidOption(message, hint=other)


@dataclass(slots=True)
class RosSteps(Language):
    """Steps of ROS 2: a mapping each, of one key that says what it is.

    Args:
        names: Names of the joints.
        tolerance: Tracking error of goals [rad or m]; None for the controller's own.
    """

    names: Sequence[str]
    tolerance: float | None

    def motion(self, motion: WrittenMotion) -> list[str]:  # noqa: D102
        frame = self.options.frame_id
        if self._is_json:
            message = message_json(self.names, motion.points, frame)
            return [f'{{"trajectory": {message.rstrip()}}}']
        if self.options.format == ExportFormat.ROS2_CONTROL:
            lines = goal_yaml(self.names, motion.points, frame, self.tolerance)
            return ["- follow_joint_trajectory:", *(f"    {line}" for line in lines)]
        lines = message_yaml(self.names, motion.points, frame)
        return ["- trajectory:", *(f"    {line}" for line in lines)]

    def fingers(self, positions: Mapping[str, float], duration: float) -> list[str]:  # noqa: D102
        return self._step("gripper", {"positions": dict(positions), "duration": duration})

    def event(self, event: Event) -> list[str]:  # noqa: D102
        value = event.value if event.kind == "set" else bool(event.value)
        return self._step(event.kind, {"port": self.port(event), "value": value})

    def wait(self, seconds: float) -> list[str]:  # noqa: D102
        return self._step("wait", {"duration": seconds})

    def call(self, name: str, *values: float) -> list[str]:  # noqa: ARG002, D102
        return self._step("call", {"name": name})

    def note(self, text: str) -> str:  # noqa: D102
        return self._step("note", {"text": text})[0] if self._is_json else f"# {text}"

    def program(self, head: Sequence[str], lines: Sequence[str]) -> list[str]:  # noqa: D102
        if self._is_json:
            return ['{"steps": [', ",\n".join(lines), "]}"]
        return [*head, "steps:", *lines]

    def _step(self, kind: str, content: dict[str, Any]) -> list[str]:
        text = json.dumps({kind: content})
        return [text] if self._is_json else [f"- {text}"]

    @property
    def _is_json(self) -> bool:
        return self.options.format == ExportFormat.JOINT_TRAJECTORY_JSON


@dataclass(slots=True)
class Table(Language):
    """One table: rows in time, with where the fingers stand and what the cell does.

    Args:
        names: Names of the joints.
        fingers_at: Positions of fingers at the beginning [rad or m].
    """

    names: Sequence[str]
    fingers_at: dict[str, float]
    _time: float = 0.0
    _last: list[str] = field(default_factory=list)
    _header: str = ""
    NOTE = "# {}"

    def motion(self, motion: WrittenMotion) -> list[str]:  # noqa: D102
        header, *rows = table(self.names, motion.points)
        self._header = self._header or header
        split = [row.split(",") for row in rows]
        began = self._time
        lines = []
        for row in split[1:] if self._last else split:
            self._time, self._last = began + float(row[0]), row[1:]
            lines.append(self._row(""))
        return lines

    def fingers(self, positions: Mapping[str, float], duration: float) -> list[str]:  # noqa: D102
        begins = self._row("gripper")
        self.fingers_at.update(positions)
        return [begins, *self.wait(duration)]

    def event(self, event: Event) -> list[str]:  # noqa: D102
        sign = "==" if event.kind == "wait_for" else "="
        return [self._row(f"{event.kind} {self.port(event)} {sign} {float(event.value):g}")]

    def wait(self, seconds: float) -> list[str]:  # noqa: D102
        self._time += seconds
        return [self._row("")]

    def call(self, name: str, *values: float) -> list[str]:  # noqa: ARG002, D102
        return [self._row(name)]

    def program(self, head: Sequence[str], lines: Sequence[str]) -> list[str]:  # noqa: D102
        columns = [self._header, *(f"gripper.{name}" for name in self.fingers_at), "event"]
        return [*head, ",".join(columns), *lines]

    def _row(self, event: str) -> str:
        values = [repr(at) for at in self.fingers_at.values()]
        return ",".join([repr(self._time), *self._last, *values, event])
