"""Programs of industrial controllers: URScript, RAPID and KRL."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Chain, JointType
from kinematics.errors import InvalidOption
from planning.exports.options import ExportFormat, ExportOptions
from planning.exports.points import ExportPoints, single_degrees

#: Joints of a URScript motion, and of the robot's own axes in RAPID and KRL.
ROBOT_AXES = 6
#: Axes beyond the robot's own in RAPID and KRL.
EXTRA_AXES = 6
#: An axis that a RAPID joint target leaves out.
_NO_AXIS = "9E9"
#: Smoothing of servoj: seconds ahead that it looks, and its proportional gain, Universal Robots'
#: defaults.
SERVOJ = "lookahead_time=0.1, gain=300"
#: RAPID's TCP speed; the speed of joint motions follows from it and from VelSet [mm/s].
_TCP_SPEED = 1000
#: Acceleration of movej where no limit of the robot is known [rad/s^2].
_ACCELERATION = 1.4


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


def servoj(points: ExportPoints, name: str) -> list[str]:
    """Lines of a URScript program that streams a motion, once the arm is at its start.

    Args:
        points: Setpoints of six joints.
        name: Of the program.
    """
    rows, times = points.positions, points.times
    lines = [f"def {name}():", *_start_check(rows[0])]
    lines += [
        f"  servoj({_radians(row)}, t={after - before!r}, {SERVOJ})"
        for row, (before, after) in zip(rows[1:], pairwise(times.tolist()), strict=True)
    ]
    return [*lines, "  stopj(2.0)", "end"]


def movej(chain: Chain, points: ExportPoints, options: ExportOptions) -> list[str]:
    """Lines of a URScript program of joint motions, the corners blended where asked for.

    Args:
        chain: Of six joints.
        points: Corners of the path.
        options: Speed, blend radius [m] and name.
    """
    speed = _share(chain.limits.velocity, options.speed, 1.0)
    acceleration = _share(chain.limits.acceleration, 1.0, _ACCELERATION)
    rows = points.positions
    lines = [f"def {options.name}():", *_start_check(rows[0])]
    for i, row in enumerate(rows[1:], start=1):
        radius = options.blend if i < len(rows) - 1 else 0.0
        lines.append(f"  movej({_radians(row)}, a={acceleration!r}, v={speed!r}, r={radius!r})")
    return [*lines, "end"]


def rapid(points: ExportPoints, options: ExportOptions, head: Sequence[str]) -> list[str]:
    """Lines of a RAPID module with one procedure of MoveAbsJ.

    Args:
        points: Corners of the path of at most six joints, and six more as external axes.
        options: Speed, zone [mm] and name.
        head: Comments, which follow the module's first line.
    """
    zone = "fine"
    lines = [f"MODULE {options.name}_module", *head]
    if options.blend:
        size = repr(float(options.blend))
        zone = "corner"
        rest = ", ".join([size] * 2 + ["1", size, "1"])
        lines.append(f"  CONST zonedata corner := [FALSE, {size}, {rest}];")
    lines += [f"  PROC {options.name}()", f"    VelSet {100.0 * min(options.speed, 1.0)!r}, 5000;"]
    rows = single_degrees(points.positions)
    for i, row in enumerate(rows):
        ends = i in (0, len(rows) - 1)
        lines.append(
            f"    MoveAbsJ {_joint_target(row)}\\NoEOffs, v{_TCP_SPEED}, "
            f"{'fine' if ends else zone}, tool0;"
        )
    return [*lines, "  ENDPROC", "ENDMODULE"]


def krl(points: ExportPoints, options: ExportOptions, head: Sequence[str]) -> list[str]:
    """Lines of a KRL program of PTP motions.

    Args:
        points: Corners of the path of at most six joints, and six more as external axes.
        options: Speed, approximation [%] and name.
        head: Comments, which follow the first line.
    """
    percent = max(1, min(100, int(100.0 * options.speed)))
    lines = [f"DEF {options.name}()", *head, "BAS(#INITMOV, 0)", f"BAS(#VEL_PTP, {percent})"]
    if options.blend:
        lines.append(f"$APO.CPTP = {int(min(100.0, options.blend))}")
    rows = single_degrees(points.positions)
    for i, row in enumerate(rows):
        blends = options.blend > 0.0 and 0 < i < len(rows) - 1
        axes = [
            f"A{k + 1}" if k < ROBOT_AXES else f"E{k + 1 - ROBOT_AXES}"
            for k in range(rows.shape[1])
        ]
        values = ", ".join(
            f"{axis} {_single(value)}" for axis, value in zip(axes, row, strict=True)
        )
        lines.append(f"PTP {{{values}}}{' C_PTP' if blends else ''}")
    return [*lines, "END"]


def _start_check(start: Array) -> list[str]:
    """A popup and halt unless each joint is within a hundredth of a radian of the first point."""
    return [
        f"  q_start = {_radians(start)}",
        "  q_now = get_actual_joint_positions()",
        "  i = 0",
        f"  while i < {len(start)}:",
        "    if norm(q_now[i] - q_start[i]) > 0.01:",
        '      popup("The arm is not at the start of the motion.", error=True, blocking=True)',
        "      halt",
        "    end",
        "    i = i + 1",
        "  end",
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
