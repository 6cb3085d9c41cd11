"""Languages of industrial controllers: lines of URScript, RAPID and KRL, and position streams.

What a cell does beside the arm is called by name: ``gripper_to`` with where the fingers go and the
time they take, and ``take_...`` for each tool. The cell has these procedures.
"""

import inspect
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import ClassVar, NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain
from obstacles.robots.tool import PART
from planning.exports import sender
from planning.exports.options import EXTRA_AXES, ROBOT_AXES, Event, ExportFormat, ExportOptions
from planning.exports.points import ExportPoints, single_degrees

#: An axis that a RAPID joint target leaves out.
_NO_AXIS = "9E9"
#: Smoothing of servoj: seconds ahead that it looks, and its proportional gain, Universal Robots'
#: defaults.
SERVOJ = "lookahead_time=0.1, gain=300"
#: How far off a joint may be where no tolerance is proved: a start that is hit [rad].
_NO_TOLERANCE = 1e-3
_NOT_THERE = "The arm is not at the start of the motion."


class WrittenMotion(NamedTuple):
    """A motion that is written.

    Args:
        points: Its points, the first one the last of the motion before.
        corners: Radius [m] of each point, or share of its legs; 0 for a stop, shape (p,).
        rests: Whether the arm rests at the end.
    """

    points: ExportPoints
    corners: Array
    rests: bool = True


@dataclass(slots=True)
class Language(ABC):
    """Lines of a program, part by part.

    Args:
        options: Options of the export.
    """

    options: ExportOptions
    #: Lines that call a procedure with values, that let time pass, and that are a comment.
    CALL: ClassVar[str]
    WAIT: ClassVar[str]
    NOTE: ClassVar[str]

    def begin(self, start: Array, tolerance: float | None) -> list[str]:  # noqa: ARG002
        """Lines that stop the program unless the arm is at its start.

        Args:
            start: First point, shape (n,) [rad].
            tolerance: How far off each joint may be by the proof [rad]; None where none is proved.
        """
        return []

    @abstractmethod
    def motion(self, motion: WrittenMotion) -> list[str]:
        """Lines of a motion from where the one before ended."""

    def fingers(self, positions: Mapping[str, float], duration: float) -> list[str]:
        """Lines that bring fingers to positions [rad or m] within a time [s]."""
        return self.call("gripper_to", *positions.values(), duration)

    @abstractmethod
    def event(self, event: Event) -> list[str]:
        """Lines that switch, set or wait for something."""

    def wait(self, seconds: float) -> list[str]:
        """Lines that let time pass."""
        return [self.WAIT.format(repr(seconds))]

    def call(self, name: str, *values: float) -> list[str]:
        """Lines that call a procedure of the cell with values."""
        return [self.CALL.format(name, ", ".join(map(repr, values)))]

    def note(self, text: str) -> str:
        """A comment, of one line of ASCII."""
        return self.NOTE.format(text)

    @abstractmethod
    def program(self, head: Sequence[str], lines: Sequence[str]) -> list[str]:
        """The program with its comments and lines."""

    def port(self, event: Event) -> int | str:
        """The number or name of the output or input of an event in the controller."""
        return self.options.ports.get(str(event.port), event.port)

    def port_number(self, event: Event, least: int = 0) -> int:
        """The number of the output or input of an event.

        Raises:
            InvalidOption: It has a name that no number is given for, or a number that there is not.
        """
        port = self.port(event)
        if not isinstance(port, int) or port < least:
            raise InvalidOption(
                f"ports: {event.port!r} has no number in {self.options.format.value}, from {least} "
                "on",
                hint='Give one: "ports": {"spindle": 2}.',
            )
        return port


def procedure(tip: str) -> str:
    """The procedure by which a cell takes the tool of a tip."""
    return f"take_{re.sub('[^A-Za-z0-9]', '_', tip.partition(PART)[0])[:19]}"


@dataclass(slots=True)
class URScript(Language):
    """Programs of Universal Robots: joint motions, or streams of setpoints.

    Args:
        chain: Chain of six joints.
    """

    chain: Chain
    CALL, WAIT, NOTE = "  {}({})", "  sleep({})", "  # {}"

    def begin(self, start: Array, tolerance: float | None) -> list[str]:  # noqa: D102
        lines = _start_check(start, tolerance)
        if self.options.blend:
            # Radii are about the flange.
            lines.append("  set_tcp(p[0, 0, 0, 0, 0, 0])")
        if self._streams:
            # Within the tolerance too; the stream then begins without a jump.
            lines.append("  movej(q_start, a=0.5, v=0.05)")
        return lines

    def motion(self, motion: WrittenMotion) -> list[str]:  # noqa: D102
        points, corners, rests = motion
        rows, times = points.positions, points.times
        if self._streams:
            lines = [
                f"  servoj({_radians(row)}, t={after - before!r}, {SERVOJ})"
                for row, (before, after) in zip(rows[1:], pairwise(times.tolist()), strict=True)
            ]
            return [*lines, "  stopj(2.0)"] if rests else lines
        speed = _share(self.chain.limits.velocity, self.options.speed, 1.0)
        # Acceleration of movej where no limit of the robot is known [rad/s^2].
        acceleration = _share(self.chain.limits.acceleration, 1.0, 1.4)
        return [
            f"  movej({_radians(row)}, a={acceleration!r}, v={speed!r}, r={radius!r})"
            for row, radius in zip(rows[1:], corners[1:].tolist(), strict=True)
        ]

    def event(self, event: Event) -> list[str]:  # noqa: D102
        port = self.port_number(event)
        if event.kind == "set":
            return [f"  set_standard_analog_out({port}, {float(event.value)!r})"]
        value = bool(event.value)
        if event.kind == "signal":
            return [f"  set_standard_digital_out({port}, {value})"]
        waits = f"  while get_standard_digital_in({port}) != {value}:"
        return [waits, "    sync()", "  end"]

    def program(self, head: Sequence[str], lines: Sequence[str]) -> list[str]:  # noqa: D102
        return [*head, f"def {self.options.name}():", *lines, "end"]

    @property
    def _streams(self) -> bool:
        return self.options.format == ExportFormat.URSCRIPT_SERVOJ


@dataclass(slots=True)
class Rapid(Language):
    """Modules of ABB's controllers, of MoveAbsJ; six joints, and six more as external axes."""

    _zones: dict[str, str] = field(default_factory=dict)
    _began: bool = False
    CALL, WAIT, NOTE = "    {} {};", "    WaitTime {};", "    ! {}"

    def begin(self, start: Array, tolerance: float | None) -> list[str]:  # noqa: D102
        own, extra = "now.robax.rax_{}", "now.extax.eax_{}"
        axes = [own.format(k + 1) for k in range(ROBOT_AXES)] + [extra.format(c) for c in "abcdef"]
        lines = []
        for off in _off_start(axes, single_degrees(start), tolerance):
            lines += [
                f"    IF {off} THEN",
                f'      ErrWrite "{self.options.name}", "{_NOT_THERE}";',
            ]
            lines += ["      EXIT;", "    ENDIF"]
        return [*lines, f"    VelSet {100.0 * min(self.options.speed, 1.0)!r}, 5000;"]

    def motion(self, motion: WrittenMotion) -> list[str]:  # noqa: D102
        rows, first = single_degrees(motion.points.positions), 1 if self._began else 0
        corners, self._began = motion.corners, True
        # RAPID's TCP speed; the speed of joint motions follows from it and from VelSet [mm/s].
        return [
            f"    MoveAbsJ {_joint_target(row)}\\NoEOffs, v1000, {self._zone(radius)}, tool0;"
            for row, radius in zip(rows[first:], corners[first:].tolist(), strict=True)
        ]

    def _zone(self, radius: float) -> str:
        if radius == 0.0:
            return "fine"
        millimetres = f"{1e3 * radius:.2f}"
        name = f"z{millimetres.replace('.', '_')}"
        size = ", ".join([millimetres, millimetres, millimetres, "1", millimetres, "1"])
        self._zones[name] = f"  CONST zonedata {name} := [FALSE, {size}];"
        return name

    def event(self, event: Event) -> list[str]:  # noqa: D102
        kind = {"signal": ("SetDO", "do"), "set": ("SetAO", "ao"), "wait_for": ("WaitDI", "di")}
        word, prefix = kind[event.kind]
        port = self.port(event)
        name = f"{prefix}{port}" if isinstance(port, int) else re.sub(r"\W", "_", str(port))[:32]
        value = float(event.value) if event.kind == "set" else int(bool(event.value))
        return [f"    {word} {name}, {value!r};"]

    def call(self, name: str, *values: float) -> list[str]:  # noqa: D102
        return [line.replace(" ;", ";") for line in Language.call(self, name, *values)]

    def program(self, head: Sequence[str], lines: Sequence[str]) -> list[str]:  # noqa: D102
        name = self.options.name
        return [
            f"MODULE {name}_module", *head, *self._zones.values(), f"  PROC {name}()",
            "    VAR jointtarget now;", "    now := CJointT();", *lines, "  ENDPROC", "ENDMODULE",
        ]  # fmt: skip


@dataclass(slots=True)
class Krl(Language):
    """Programs of KUKA's controllers, of PTP motions; six joints, and six more as external axes."""

    _began: bool = False
    CALL, WAIT, NOTE = "{}({})", "WAIT SEC {}", "; {}"

    def begin(self, start: Array, tolerance: float | None) -> list[str]:  # noqa: D102
        axes = self._axes(len(start))
        lines = [f"; Halts as long as it holds: {_NOT_THERE}"]
        off_start = _off_start([f"$AXIS_ACT.{axis}" for axis in axes], single_degrees(start),
                               tolerance)  # fmt: skip
        for off in off_start:
            lines += [f"WHILE {off}", "HALT", "ENDWHILE"]
        return lines

    def motion(self, motion: WrittenMotion) -> list[str]:  # noqa: D102
        rows, first = single_degrees(motion.points.positions), 1 if self._began else 0
        corners, self._began = motion.corners, True
        axes, lines = self._axes(rows.shape[1]), list[str]()
        for row, share in zip(rows[first:], corners[first:].tolist(), strict=True):
            # Of half of a leg, in whole percents.
            percent = int(200.0 * share)
            values = ", ".join(f"{a} {_single(x)}" for a, x in zip(axes, row, strict=True))
            lines += [f"$APO.CPTP = {percent}"] if percent else []
            lines.append(f"PTP {{{values}}}{' C_PTP' if percent else ''}")
        return lines

    def event(self, event: Event) -> list[str]:  # noqa: D102
        port = self.port_number(event, 1)
        if event.kind == "set":
            return [f"$ANOUT[{port}] = {float(event.value)!r}"]
        if event.kind == "signal":
            return [f"$OUT[{port}] = {'TRUE' if event.value else 'FALSE'}"]
        return [f"WAIT FOR {'' if event.value else 'NOT '}$IN[{port}]"]

    def program(self, head: Sequence[str], lines: Sequence[str]) -> list[str]:  # noqa: D102
        percent = max(1, min(100, int(100.0 * self.options.speed)))
        first = [f"DEF {self.options.name}()", *head, "BAS(#INITMOV, 0)"]
        return [*first, f"BAS(#VEL_PTP, {percent})", *lines, "END"]

    @staticmethod
    def _axes(count: int) -> list[str]:
        return [f"A{k + 1}" if k < ROBOT_AXES else f"E{k + 1 - ROBOT_AXES}" for k in range(count)]


@dataclass(slots=True)
class Stream(Language):
    """Programs of Python that send a position to the controller at each of its cycles.

    Args:
        count: Number of axes.
    """

    count: int
    _rows: list[Array] = field(default_factory=list)
    _tolerance: float = _NO_TOLERANCE
    NOTE = "    # {}"

    def begin(self, start: Array, tolerance: float | None) -> list[str]:  # noqa: ARG002, D102
        self._tolerance = tolerance or _NO_TOLERANCE
        return []

    def motion(self, motion: WrittenMotion) -> list[str]:  # noqa: D102
        return self._send(np.rad2deg(motion.points.positions)[1 if self._rows else 0 :])

    def wait(self, seconds: float) -> list[str]:  # noqa: D102
        cycles = int(np.ceil(seconds / self.options.period - 1e-9))
        return self._send(np.repeat(self._rows[-1][None], cycles, axis=0))

    def event(self, event: Event) -> list[str]:  # noqa: D102
        return self.call(f"{event.kind} {event.port}")

    def call(self, name: str, *values: float) -> list[str]:  # noqa: ARG002, D102
        raise InvalidOption(
            f"format: {self.options.format.value} streams positions alone, the program has {name}",
            hint="Export it as rapid or krl, or each of its motions by itself.",
        )

    def program(self, head: Sequence[str], lines: Sequence[str]) -> list[str]:  # noqa: D102
        rows, is_rsi = np.array(self._rows), self.options.format == ExportFormat.RSI
        ranges = zip(rows.min(axis=0) - rows[0], rows.max(axis=0) - rows[0], strict=True)
        told = ", ".join(f"A{k} {low:.3f} to {high:.3f}" for k, (low, high) in enumerate(ranges, 1))
        needs = [f"# AXISCORR, set to absolute corrections, has to allow (degrees): {told}."]
        protocol, tolerance = "Rsi" if is_rsi else "Egm", float(np.rad2deg(self._tolerance))
        return [
            *head, f"# One position each {self.options.period:g} s, in degrees.",
            *(needs if is_rsi else []), *inspect.getsource(sender).splitlines(), "", "",
            "POSITIONS = [", *lines, "]", 'if __name__ == "__main__":',
            f"    main({protocol}(), POSITIONS, {tolerance!r})",
        ]  # fmt: skip

    def _send(self, rows: Array) -> list[str]:
        rows = np.round(rows, self.options.traits.decimals or 0)
        self._rows += [*rows]
        return [f"    {row}," for row in rows.tolist()]


def _start_check(start: Array, tolerance: float | None) -> list[str]:
    """A popup and halt unless each joint is as near to the first point as is proved."""
    return [
        f"  q_start = {_radians(start)}",
        "  q_now = get_actual_joint_positions()",
        "  i = 0",
        f"  while i < {len(start)}:",
        f"    if norm(q_now[i] - q_start[i]) > {tolerance or _NO_TOLERANCE!r}:",
        f'      popup("{_NOT_THERE}", error=True, blocking=True)',
        "      halt",
        "    end",
        "    i = i + 1",
        "  end",
    ]


def _off_start(
    axes: Sequence[str], start: np.ndarray[tuple[int, ...], np.dtype[np.float32]],
    tolerance: float | None,
) -> list[str]:  # fmt: skip
    """Conditions of RAPID and KRL that hold where an axis is off its start [degrees]."""
    # Digits of single precision may make a number larger by less, as a share.
    degrees = np.rad2deg((tolerance or _NO_TOLERANCE) * (1.0 - 1e-6))
    most = _single(np.float32(degrees))
    return [
        f"ABS({axis} - ({_single(value)})) > {most}"
        for axis, value in zip(axes, start, strict=False)
    ]


def _joint_target(
    row: Sequence[np.float32] | np.ndarray[tuple[int, ...], np.dtype[np.float32]],
) -> str:
    values = [_single(value) for value in row]
    own = [*values[:ROBOT_AXES], *["0"] * (ROBOT_AXES - len(values))]
    extra = values[ROBOT_AXES:]
    extra += [_NO_AXIS] * (EXTRA_AXES - len(extra))
    return f"[[{', '.join(own)}], [{', '.join(extra)}]]"


def _share(limit: Array, share: float, otherwise: float) -> float:
    """A share of the least known limit; ``otherwise`` where none is known."""
    known = limit[np.isfinite(limit)]
    return float(known.min()) * share if len(known) else otherwise * share


def _radians(row: Array) -> str:
    return f"[{', '.join(repr(value) for value in row.tolist())}]"


def _single(value: np.float32) -> str:
    """A number of single precision with the digits that tell it from all others."""
    return np.format_float_positional(value, unique=True, trim="0")
