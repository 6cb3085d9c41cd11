"""Options of an export: format, points, and what a program says."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal, NamedTuple

from kinematics.errors import InvalidOption


class ExportFormat(StrEnum):
    """Files that controllers read."""

    JOINT_TRAJECTORY_JSON = "joint_trajectory_json"
    JOINT_TRAJECTORY_YAML = "joint_trajectory_yaml"
    ROS2_CONTROL = "ros2_control"
    CSV = "csv"
    URSCRIPT_SERVOJ = "urscript_servoj"
    URSCRIPT_MOVEJ = "urscript_movej"
    RAPID = "rapid"
    KRL = "krl"
    EGM = "egm"
    RSI = "rsi"


class Rule(StrEnum):
    """Interpolation between two exported points."""

    QUINTIC = "quintic"
    CUBIC = "cubic"
    LINEAR = "linear"
    STRAIGHT_LEGS = "straight_legs"


class FormatTraits(NamedTuple):
    """Traits of a format.

    Args:
        kind: "spline" where the reader interpolates by what is given of each point, "stream" for
            setpoints, and "path" where the controller times the points itself.
        ending: Ending of the files.
        gaps: Sentences on what a proof by the format's rule leaves open.
        sign: Sign that begins a comment; JSON has none.
        joints: Numbers of joints that its motions can have; None for any.
        cycles: Periods at which the controller takes setpoints [s]; the first where none is asked
            for. None for any.
        decimals: Decimals of a degree that setpoints have; None where they are in radians.
    """

    kind: Literal["spline", "stream", "path"]
    ending: str
    gaps: tuple[str, ...] = ()
    sign: str = "#"
    joints: range | None = None
    cycles: tuple[float, ...] | None = None
    decimals: int | None = None


#: Joints of a URScript motion, and of the robot's own axes in RAPID and KRL.
ROBOT_AXES = 6
#: Axes beyond the robot's own in RAPID and KRL.
EXTRA_AXES = 6
_ROS = ("Other settings of joint_trajectory_controller than interpolation_method: splines.",)
_SERVOJ = (
    "The smoothing of servoj by lookahead_time and gain, which is not published: only the "
    "setpoints and the lines between them are proved."
)
_STREAM = (
    "{} Only the positions that are sent and the lines between them are proved; a message that is "
    "lost or late holds the arm up on its way."
)
_EGM = _STREAM.format("The low-pass filter, the ramps and the speed limits of EGM.")
_RSI = _STREAM.format("The filters and limits of RSI.")
_PROPORTION = ("Axes that do not keep step between two points, so that the leg is not straight.",)
_SIX, _TWELVE = range(ROBOT_AXES, ROBOT_AXES + 1), range(1, ROBOT_AXES + EXTRA_AXES + 1)
#: Traits of the formats.
TRAITS = {
    ExportFormat.JOINT_TRAJECTORY_JSON: FormatTraits("spline", "json", _ROS),
    ExportFormat.JOINT_TRAJECTORY_YAML: FormatTraits("spline", "yaml", _ROS),
    ExportFormat.ROS2_CONTROL: FormatTraits("spline", "yaml", _ROS),
    ExportFormat.CSV: FormatTraits(
        "spline", "csv", ("A reader of the table that interpolates in another way.",)
    ),
    ExportFormat.URSCRIPT_SERVOJ: FormatTraits("stream", "script", (_SERVOJ,), joints=_SIX),
    ExportFormat.URSCRIPT_MOVEJ: FormatTraits("path", "script", joints=_SIX),
    ExportFormat.RAPID: FormatTraits("path", "mod", _PROPORTION, "!", _TWELVE),
    ExportFormat.KRL: FormatTraits("path", "src", _PROPORTION, ";", _TWELVE),
    ExportFormat.EGM: FormatTraits(
        "stream", "py", (_EGM,), "#", _TWELVE, tuple(0.004 * k for k in range(1, 13)), 9
    ),
    ExportFormat.RSI: FormatTraits("stream", "py", (_RSI,), "#", _TWELVE, (0.012, 0.004), 6),
}
#: Formats that give the points of a path.
PATH_FORMATS = frozenset(one for one, traits in TRAITS.items() if traits.kind == "path")
#: Names that URScript, RAPID and KRL all take (KRL has up to 24 characters).
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,23}")


@dataclass(frozen=True, slots=True)
class Event:
    """A word of a program with the machines around.

    Args:
        kind: "signal" switches a digital output, "set" gives an analog output a number, "wait_for"
            waits for a digital input.
        port: Number or name of the output or input.
        value: On or off, or the number.
    """

    kind: Literal["signal", "set", "wait_for"]
    port: int | str
    value: float


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """Options of an export.

    Args:
        format: The file to write.
        sample_period: Time between points; quintics have points where pieces of the motion meet as
            well, cubics where the acceleration jumps. A path is chosen among points this far
            apart [s]. None takes 0.01 s, or the cycle of the controller that a stream is for.
        sample_count: Number of points of messages and tables, evenly spaced in time, in place of a
            period; none are added where pieces meet.
        least_spacing: Least time between points of messages and tables: points that are nearer to
            the one before are left out, the ends never [s].
        interpolation: "quintic", "cubic" or "linear", for messages and tables. None takes
            "quintic" where the acceleration is continuous, "cubic" elsewhere.
        path_tolerance: Distance of the motion from the legs of a path at most [rad or m].
        blend: How far the flange may be from a point of a path where the controller begins to cut
            its corner, at most [m]; what is proved may be less. 0 stops at each point.
        speed: Share of the joints' velocity limits, for paths.
        name: Name of the program.
        frame_id: Frame id of the header of a message.
        ports: Numbers or names in the controller of outputs and inputs, by what stages call them.
        gripper: Digital output that closes the gripper; None where the cell has ``gripper_to``.

    Raises:
        InvalidOption: A value is out of its range, or does not belong to the format.
    """

    format: ExportFormat
    sample_period: float | None = None
    interpolation: str | None = None
    path_tolerance: float = 1e-3
    blend: float = 0.0
    speed: float = 0.1
    name: str = "armwright"
    frame_id: str = ""
    ports: Mapping[str, int | str] = field(default_factory=dict)
    gripper: int | str | None = None
    sample_count: int | None = None
    least_spacing: float = 0.0

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise InvalidOption(
                f"name: {self.name!r} is no name of a program",
                hint="Begin with a letter; letters, digits and _, at most 24 in all.",
            )
        if self.blend < 0.0 or (self.blend and not self.is_path):
            raise InvalidOption(
                f"blend: {self.blend:g} does not fit the format {self.format.value!r}",
                hint="Only urscript_movej, rapid and krl blend; 0 stops at each point.",
            )
        if self.interpolation is not None:
            self._check_interpolation(self.interpolation)
        self._check_spacing()
        for quantity in ("period", "path_tolerance", "speed"):
            if not getattr(self, quantity) > 0.0:
                raise InvalidOption(f"{quantity}: must be positive")
        cycles = self.traits.cycles
        if cycles is not None and not any(abs(self.period - one) < 1e-9 for one in cycles):
            known = ", ".join(f"{one:g}" for one in cycles)
            raise InvalidOption(
                f"sample_period: {self.format.value} takes a position each {known} s, "
                f"not each {self.period:g} s",
                hint="Give one of these, or leave sample_period out.",
            )

    def _check_spacing(self) -> None:
        if self.sample_count is None and not self.least_spacing:
            return
        if not self.is_spline:
            raise InvalidOption(
                f"sample_count and least_spacing do not belong to the format {self.format.value!r}",
                hint="Messages and tables have them.",
            )
        if self.sample_count is not None and (self.sample_period or self.sample_count < 2):
            raise InvalidOption(
                f"sample_count: {self.sample_count} points, and a period of {self.sample_period} s",
                hint="Give 2 points or more, or a period.",
            )
        if not 0.0 <= self.least_spacing < math.inf:
            raise InvalidOption(f"least_spacing: {self.least_spacing:g} s", hint="Give 0 or more.")

    @property
    def traits(self) -> FormatTraits:
        """Traits of the format."""
        return TRAITS[self.format]

    @property
    def period(self) -> float:
        """Time between points [s]."""
        if self.sample_period is not None:
            return self.sample_period
        return 0.01 if self.traits.cycles is None else self.traits.cycles[0]

    @property
    def is_path(self) -> bool:
        """Whether the file holds a path that the controller times."""
        return self.traits.kind == "path"

    @property
    def is_spline(self) -> bool:
        """Whether the reader of the file interpolates by what is given of each point."""
        return self.traits.kind == "spline"

    @property
    def file_name(self) -> str:
        """The program's name with the ending of the format."""
        return f"{self.name}.{self.traits.ending}"

    def _check_interpolation(self, interpolation: str) -> None:
        if not self.is_spline:
            raise InvalidOption(
                f"interpolation: the format {self.format.value!r} has its own",
                hint="Leave interpolation out.",
            )
        if interpolation not in (Rule.QUINTIC, Rule.CUBIC, Rule.LINEAR):
            raise InvalidOption(
                f"interpolation: there is no {interpolation!r} here",
                hint="Choose quintic, cubic or linear.",
            )
