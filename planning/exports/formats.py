"""Programs of industrial controllers: URScript, RAPID and KRL.

Points of a motion as a file has them, digits that the file drops included.
"""

import csv
import io
import json
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain, JointType
from kinematics.trajectory.export import NANOSECONDS, nanoseconds, rows_at
from kinematics.trajectory.trajectory import Trajectory
from planning.exports.options import ExportFormat, ExportOptions, Rule
from planning.timing.path.simplification import kept_waypoints
from planning.values.limits import JERK_JUMP


class ExportPoints(NamedTuple):
    """Points with what a file gives of them.

    Args:
        rule: The interpolation between them.
        ticks: Times, strictly increasing from 0, shape (p,) [ns].
        derivatives: Positions, and as the rule needs them velocities and accelerations, each of
            shape (p, n).
    """

    rule: Rule
    ticks: Indices
    derivatives: tuple[Array, ...]

    @property
    def times(self) -> Array:
        """Times of the points, shape (p,) [s]."""
        return self.ticks / NANOSECONDS

    @property
    def positions(self) -> Array:
        """Positions, shape (p, n) [rad or m]."""
        return self.derivatives[0]


def export_points(trajectory: Trajectory, options: ExportOptions) -> ExportPoints:
    """The points that a format gives of a motion.

    Args:
        trajectory: The motion.
        options: Format, period and tolerance.

    Raises:
        InvalidOption: The period gives too many points.
    """
    period = options.sample_period
    # Points of one file: at half a kilobyte each, fifty megabytes.
    max_points = 100_000
    if trajectory.duration / period > max_points:
        raise InvalidOption(
            f"sample_period: {period:g} s over {trajectory.duration:g} s gives more than "
            f"{max_points} points",
            hint=f"Give at least {trajectory.duration / max_points:.3g} s.",
        )
    trajectory = _in_whole_nanoseconds(trajectory)
    times, rule = trajectory.uniform_samples(period), _rule(trajectory, options)
    if rule == Rule.STRAIGHT_LEGS:
        positions = trajectory.sample(times)
        times = times[kept_waypoints(positions, options.path_tolerance)]
    elif rule in (Rule.QUINTIC, Rule.CUBIC):
        times = _with_breaks(trajectory, times, period, rule)
    ticks = nanoseconds(times)
    if rule != Rule.STRAIGHT_LEGS:
        # Where the motion is at the times that the file names: beside a near point, half a
        # nanosecond of difference would be felt in the acceleration.
        times = np.append(ticks[:-1] / NANOSECONDS, trajectory.duration)
    count = {Rule.QUINTIC: 3, Rule.CUBIC: 2}.get(rule, 1)
    rows = rows_at(trajectory, times, count)
    if options.format in (ExportFormat.RAPID, ExportFormat.KRL):
        rows = (np.deg2rad(single_degrees(rows[0]).astype(np.float64)),)
    return ExportPoints(rule, ticks, rows)


def _in_whole_nanoseconds(trajectory: Trajectory) -> Trajectory:
    """The motion with a duration that files can tell, slower by less than a nanosecond.

    Its last point is then where and as fast as the motion ends.
    """
    count = trajectory.duration * NANOSECONDS
    nearest = float(max(round(count), 1))
    # Durations that are off a whole nanosecond by less are off by rounding [ns].
    whole = nearest if abs(count - nearest) <= 1e-5 else float(np.ceil(count))
    return trajectory if whole == count else trajectory.dilate(whole / count)


def single_degrees(positions: Array) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    """Angles [rad] in degrees as numbers of single precision, which RAPID and KRL compute with."""
    return np.rad2deg(positions).astype(np.float32)


def _with_breaks(trajectory: Trajectory, times: Array, period: float, rule: Rule) -> Array:
    """Times, and those at which pieces of the motion meet, as far as the rule needs them.

    Quintics between points of one piece of degree 5 at most are that piece, and keep its limits;
    across two pieces they exceed them by some percent. Any polynomial overshoots where it passes a
    jump of the acceleration.
    """
    breaks = trajectory.breaks[1:-1]
    # Degree of the polynomials that controllers interpolate by at most.
    if rule != Rule.QUINTIC or trajectory.coefficients[:, :, 6:].any():
        jumps = np.abs(trajectory.jumps(2)).max(axis=1, initial=0.0) > JERK_JUMP
        breaks = breaks[jumps]
    if not len(breaks):
        return times
    after = np.searchsorted(breaks, times[1:-1])
    padded = np.concatenate([[-np.inf], breaks, [np.inf]])
    gaps = np.minimum(times[1:-1] - padded[after], padded[after + 1] - times[1:-1])
    # A point this near to one where two pieces meet gives way to it, a share of the period.
    inner = times[1:-1][gaps > 0.1 * period]
    return np.unique(np.concatenate([times[:1], inner, breaks, times[-1:]]))


def _rule(trajectory: Trajectory, options: ExportOptions) -> Rule:
    if options.is_path:
        return Rule.STRAIGHT_LEGS
    if options.format == ExportFormat.URSCRIPT_SERVOJ:
        return Rule.LINEAR
    if options.interpolation is not None:
        return Rule(options.interpolation)
    smooth = trajectory.continuity().acceleration <= JERK_JUMP
    return Rule.QUINTIC if smooth else Rule.CUBIC


_COLUMNS = ("position", "velocity", "acceleration")
_FIELDS = ("positions", "velocities", "accelerations")
#: Joints of a URScript motion, and of the robot's own axes in RAPID and KRL.
ROBOT_AXES = 6
#: Axes beyond the robot's own in RAPID and KRL.
EXTRA_AXES = 6
#: An axis that a RAPID joint target leaves out.
_NO_AXIS = "9E9"
#: Smoothing of servoj: seconds ahead that it looks, and its proportional gain, Universal Robots'
#: defaults.
SERVOJ = "lookahead_time=0.1, gain=300"
#: How far off a joint may be where no tolerance is proved: a start that is hit [rad].
_NO_TOLERANCE = 1e-3
_NOT_THERE = "The arm is not at the start of the motion."


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


def servoj(points: ExportPoints, name: str, tolerance: float | None) -> list[str]:
    """Lines of a URScript program that streams a motion, once the arm is at its start.

    Args:
        points: Setpoints of six joints.
        name: Name of the program.
        tolerance: How far off each joint may be by the proof [rad]; None where none is proved.
    """
    rows, times = points.positions, points.times
    lines = [f"def {name}():", *_start_check(rows[0], tolerance)]
    # Within the tolerance too; the stream then begins without a jump.
    lines.append("  movej(q_start, a=0.5, v=0.05)")
    lines += [
        f"  servoj({_radians(row)}, t={after - before!r}, {SERVOJ})"
        for row, (before, after) in zip(rows[1:], pairwise(times.tolist()), strict=True)
    ]
    return [*lines, "  stopj(2.0)", "end"]


def movej(
    chain: Chain, points: ExportPoints, options: ExportOptions, tolerance: float | None
) -> list[str]:
    """Lines of a URScript program of joint motions, the corners blended where asked for.

    Args:
        chain: Chain of six joints.
        points: Corners of the path.
        options: Speed, blend radius [m] and name.
        tolerance: How far off its start each joint may be [rad]; None where none is proved.
    """
    speed = _share(chain.limits.velocity, options.speed, 1.0)
    # Acceleration of movej where no limit of the robot is known [rad/s^2].
    acceleration = _share(chain.limits.acceleration, 1.0, 1.4)
    rows = points.positions
    lines = [f"def {options.name}():", *_start_check(rows[0], tolerance)]
    for i, row in enumerate(rows[1:], start=1):
        radius = options.blend if i < len(rows) - 1 else 0.0
        lines.append(f"  movej({_radians(row)}, a={acceleration!r}, v={speed!r}, r={radius!r})")
    return [*lines, "end"]


def rapid(
    points: ExportPoints, options: ExportOptions, head: Sequence[str], tolerance: float | None
) -> list[str]:
    """Lines of a RAPID module with one procedure of MoveAbsJ.

    Args:
        points: Corners of the path of at most six joints, and six more as external axes.
        options: Speed, zone [mm] and name.
        head: Comments, which follow the module's first line.
        tolerance: How far off its start each joint may be [rad]; None where none is proved.
    """
    zone = "fine"
    lines = [f"MODULE {options.name}_module", *head]
    if options.blend:
        size = repr(float(options.blend))
        zone = "corner"
        rest = ", ".join([size] * 2 + ["1", size, "1"])
        lines.append(f"  CONST zonedata corner := [FALSE, {size}, {rest}];")
    rows = single_degrees(points.positions)
    own, extra = "now.robax.rax_{}", "now.extax.eax_{}"
    axes = [own.format(k + 1) for k in range(ROBOT_AXES)] + [extra.format(c) for c in "abcdef"]
    lines += [f"  PROC {options.name}()", "    VAR jointtarget now;", "    now := CJointT();"]
    for off in _off_start(axes, rows[0], tolerance):
        lines += [f"    IF {off} THEN", f'      ErrWrite "{options.name}", "{_NOT_THERE}";']
        lines += ["      EXIT;", "    ENDIF"]
    lines.append(f"    VelSet {100.0 * min(options.speed, 1.0)!r}, 5000;")
    for i, row in enumerate(rows):
        ends = i in (0, len(rows) - 1)
        # RAPID's TCP speed; the speed of joint motions follows from it and from VelSet [mm/s].
        lines.append(
            f"    MoveAbsJ {_joint_target(row)}\\NoEOffs, v1000, {'fine' if ends else zone}, tool0;"
        )
    return [*lines, "  ENDPROC", "ENDMODULE"]


def krl(
    points: ExportPoints, options: ExportOptions, head: Sequence[str], tolerance: float | None
) -> list[str]:
    """Lines of a KRL program of PTP motions.

    Args:
        points: Corners of the path of at most six joints, and six more as external axes.
        options: Speed, approximation [%] and name.
        head: Comments, which follow the first line.
        tolerance: How far off its start each joint may be [rad]; None where none is proved.
    """
    percent = max(1, min(100, int(100.0 * options.speed)))
    lines = [f"DEF {options.name}()", *head, "BAS(#INITMOV, 0)", f"BAS(#VEL_PTP, {percent})"]
    if options.blend:
        lines.append(f"$APO.CPTP = {int(min(100.0, options.blend))}")
    rows = single_degrees(points.positions)
    axes = [
        f"A{k + 1}" if k < ROBOT_AXES else f"E{k + 1 - ROBOT_AXES}" for k in range(rows.shape[1])
    ]
    lines.append(f"; Halts as long as it holds: {_NOT_THERE}")
    for off in _off_start([f"$AXIS_ACT.{axis}" for axis in axes], rows[0], tolerance):
        lines += [f"WHILE {off}", "HALT", "ENDWHILE"]
    for i, row in enumerate(rows):
        blends = options.blend > 0.0 and 0 < i < len(rows) - 1
        values = ", ".join(
            f"{axis} {_single(value)}" for axis, value in zip(axes, row, strict=True)
        )
        lines.append(f"PTP {{{values}}}{' C_PTP' if blends else ''}")
    return [*lines, "END"]


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
