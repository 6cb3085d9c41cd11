"""Programs of ROS 2 and tables: motions and what the cell does between them, as steps in order."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from kinematics.arrays import Array
from planning.exports import formats
from planning.exports.languages import WrittenMotion
from planning.exports.options import Event, ExportFormat, ExportOptions


@dataclass(slots=True)
class RosSteps:
    """Steps of ROS 2: a mapping each, of one key that says what it is.

    Args:
        names: Names of the joints.
        options: Options of the export.
        tolerance: Tracking error of goals [rad or m]; None for the controller's own.
    """

    names: Sequence[str]
    options: ExportOptions
    tolerance: float | None

    def begin(self, start: Array, tolerance: float | None) -> list[str]:  # noqa: ARG002, D102
        return []

    def motion(self, motion: WrittenMotion) -> list[str]:  # noqa: D102
        frame = self.options.frame_id
        if self._is_json:
            message = formats.message_json(self.names, motion.points, frame)
            return [f'{{"trajectory": {message.rstrip()}}}']
        if self.options.format == ExportFormat.ROS2_CONTROL:
            lines = formats.goal_yaml(self.names, motion.points, frame, self.tolerance)
            return ["- follow_joint_trajectory:", *(f"    {line}" for line in lines)]
        lines = formats.message_yaml(self.names, motion.points, frame)
        return ["- trajectory:", *(f"    {line}" for line in lines)]

    def fingers(self, positions: Mapping[str, float], duration: float) -> list[str]:  # noqa: D102
        return self._step("gripper", {"positions": dict(positions), "duration": duration})

    def event(self, event: Event) -> list[str]:  # noqa: D102
        port = self.options.ports.get(str(event.port), event.port)
        value = event.value if event.kind == "set" else bool(event.value)
        return self._step(event.kind, {"port": port, "value": value})

    def wait(self, seconds: float) -> list[str]:  # noqa: D102
        return self._step("wait", {"duration": seconds})

    def call(self, name: str) -> list[str]:  # noqa: D102
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
class Table:
    """One table: rows in time, with where the fingers stand and what the cell does.

    Args:
        names: Names of the joints.
        fingers_at: Positions of fingers at the beginning [rad or m].
        options: Options of the export.
    """

    names: Sequence[str]
    fingers_at: dict[str, float]
    options: ExportOptions
    _time: float = 0.0
    _last: list[str] = field(default_factory=list)
    _header: str = ""

    def begin(self, start: Array, tolerance: float | None) -> list[str]:  # noqa: ARG002, D102
        return []

    def motion(self, motion: WrittenMotion) -> list[str]:  # noqa: D102
        header, *rows = formats.table(self.names, motion.points)
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
        port = self.options.ports.get(str(event.port), event.port)
        sign = "==" if event.kind == "wait_for" else "="
        return [self._row(f"{event.kind} {port} {sign} {float(event.value):g}")]

    def wait(self, seconds: float) -> list[str]:  # noqa: D102
        self._time += seconds
        return [self._row("")]

    def call(self, name: str) -> list[str]:  # noqa: D102
        return [self._row(name)]

    def note(self, text: str) -> str:  # noqa: D102
        return f"# {text}"

    def program(self, head: Sequence[str], lines: Sequence[str]) -> list[str]:  # noqa: D102
        columns = [self._header, *(f"gripper.{name}" for name in self.fingers_at), "event"]
        return [*head, ",".join(columns), *lines]

    def _row(self, event: str) -> str:
        values = [repr(at) for at in self.fingers_at.values()]
        return ",".join([repr(self._time), *self._last, *values, event])
