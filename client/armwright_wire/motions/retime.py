"""Timing of given paths, paths of fewer waypoints, and motions in other shapes, on the wire."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import AliasChoices, ConfigDict, Field, model_validator
from pydantic.config import JsonDict

from armwright_wire.base import (
    MAX_JOINTS,
    Answer,
    Beside,
    Body,
    BodyWithRules,
    JointVector,
    Label,
    Name,
    NonNegative,
    Number,
    Positive,
    Timeout,
    examples,
    is_given,
)
from armwright_wire.motions.certificate import CertificateAnswer
from armwright_wire.motions.timing import Timing, TimingAnswer
from armwright_wire.motions.trajectory import (
    JointRow,
    LimitsBody,
    Samples,
    TrajectoryAnswer,
    TrajectoryBody,
)
from armwright_wire.scenes.check import SceneRequest, WithFingers
from armwright_wire.scenes.tool import WithTool

#: A path of so many waypoints takes some seconds.
MAX_WAYPOINTS = 20_000
#: Each of so many stretches is timed by itself.
MAX_STRETCHES = 200

Waypoints = Annotated[list[JointVector], Field(min_length=1, max_length=MAX_WAYPOINTS)]
Names = Annotated[list[Label], Field(min_length=1, max_length=MAX_JOINTS)]


#: Options of the timing between two states.
_STATE_TIMING = {
    "method",
    "velocity_scaling",
    "acceleration_scaling",
    "jerk_scaling",
    "sample_period",
    "sample_count",
}


class PathBody(Body):
    """Waypoints in joint space."""

    joints: Waypoints
    """waypoints in their order [rad or m]"""
    joint_names: Names | None = None
    """where no robot is named"""


class PathTolerance(Body):
    """Tolerance of the path that is found."""

    tolerance: Positive = Field(examples=[0.001])
    """how far the motion may be from the straight lines of the path, in any joint at every place:
    few of its waypoints, or a smooth curve, stand for all [rad or m]
    """


class PathToKeep(PathBody):
    """Waypoints in joint space that a motion is to be near."""

    tolerance: Positive = Field(examples=[0.001])
    """how far the motion may be from the straight lines through the waypoints, in any joint at
    every place, both run through in the same order [rad or m]
    """


class RetimePath(PathBody):
    """Waypoints in joint space, and what is to lead through them or near them."""

    tolerance: Positive | None = Field(None, examples=[0.001])
    """how far the motion may be from the straight lines through the waypoints, in any joint at
    every place: few of them, or a smooth curve, stand for all [rad or m]
    """
    knots: Annotated[list[Number], Field(min_length=2, max_length=MAX_WAYPOINTS)] | None = None
    """of a spline, strictly increasing; times for the method spline [s]"""


class LimitsAt(Body):
    """Limits along a stretch of a path, beside those of the whole motion."""

    begin: NonNegative = Field(validation_alias=AliasChoices("from"), serialization_alias="from")
    """waypoint at which it begins, counted from 0, between two where it has a fraction; by length:
    that of straight lines through the waypoints [rad or m]
    """
    end: NonNegative = Field(validation_alias=AliasChoices("to"), serialization_alias="to")
    """where it ends, likewise"""
    by: Literal["waypoint", "length"] = "waypoint"
    """count of from and to: waypoints, or Euclidean length"""
    velocity: JointRow | None = None
    """of each joint [rad/s or m/s]"""
    acceleration: JointRow | None = None
    """of each joint [rad/s² or m/s²]"""
    tool_speed: Positive | None = None
    """of the tip, with a robot [m/s]"""


class RetimeTiming(Timing):
    """Options of the timing."""

    times: Annotated[list[Number], Field(min_length=2, max_length=MAX_WAYPOINTS)] | None = None
    """at the waypoints, for the methods spline and jerk_limited, from any number on [s]. By spline
    limits that are not known are not needed: the motion's peaks are reported. By jerk_limited all
    limits hold, or the first leg that takes longer is named
    """
    velocities: Annotated[list[JointVector | None], Field(max_length=MAX_WAYPOINTS)] | None = Field(
        None, examples=[[[0.0, 0.0], None, [0.0, 0.0]]]
    )
    """at the waypoints beside times, for jerk_limited; null where any will do. Left out, the motion
    rests at its ends [rad/s or m/s]
    """
    start_velocity: JointVector | None = None
    """along the path; at rest if left out. A spline with times takes any: this end is clamped to
    it, of natural_spline too, whose other end stays natural
    """
    end_velocity: JointVector | None = None
    """likewise, at the end"""


class JointStateBody(Body):
    """Position, velocity and acceleration of all joints."""

    position: JointVector
    """[rad or m]"""
    velocity: JointVector | None = None
    """at rest if left out [rad/s or m/s]"""
    acceleration: JointVector | None = None
    """zero if left out [rad/s² or m/s²]"""


#: A path is timed alone: what belongs to two states is left out beside it.
_OF_PATH: JsonDict = {
    "required": ["path"],
    "properties": {
        "path": {"not": {"type": "null"}},
        "from": {"type": "null"},
        "to": {"type": "null"},
        "joint_names": {"type": "null"},
        "synchronization": {"type": "null"},
    },
}
_OF_STATES: JsonDict = {
    "required": ["from", "to"],
    "properties": {
        "path": {"type": "null"},
        "from": {"not": {"type": "null"}},
        "to": {"not": {"type": "null"}},
        "limits_at": {"type": "null"},
    },
}


class RetimeRequest(WithTool):
    """A path, or two states, to be timed within a robot's limits or those given."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": examples("RetimeRequest"),
            "allOf": [{"anyOf": [_OF_PATH, _OF_STATES]}],
        }
    )

    path: RetimePath | None = None
    start: JointStateBody | None = Field(
        None, validation_alias=AliasChoices("from"), serialization_alias="from"
    )
    """in place of a path: the state to begin with"""
    end: JointStateBody | None = Field(
        None, validation_alias=AliasChoices("to"), serialization_alias="to"
    )
    """in place of a path: the state to end with"""
    joint_names: Names | None = None
    """of the two states, where no robot is named"""
    synchronization: Literal["phase", "time"] | None = None
    """of the joints between two states: phase (if left out) for a straight line where the states
    allow one, time for arriving together only
    """
    robot: Name | None = Field(None, examples=["panda"])
    """name of a stored or built-in robot, whose limits hold where none are given"""
    limits: LimitsBody | None = None
    limits_at: Annotated[list[LimitsAt], Field(max_length=MAX_STRETCHES)] | None = Field(
        None, examples=[[{"from": 2, "to": 5, "tool_speed": 0.1}]]
    )
    """limits along stretches of the path, beside the others; where stretches overlap, the tighter
    ones hold. Not for the method spline
    """
    timing: RetimeTiming = Field(default_factory=RetimeTiming)
    stops: Literal["none", "path"] = "none"
    """path: prove that the arm can come to rest along its path from every instant; stops of single
    joints leave it, plan and validate prove these
    """
    timeout: Timeout | None = None

    @model_validator(mode="after")
    def _check_form(self) -> "RetimeRequest":
        if self.path is not None:
            extra = {"start": "from", "end": "to", "joint_names": "joint_names"}
            extra |= {"synchronization": "synchronization"}
            for name, wire in extra.items():
                if getattr(self, name) is not None:
                    raise ValueError(f"{wire} belongs to two states; leave it or path out")
            return self
        if self.start is None or self.end is None:
            raise ValueError("give path, or both from and to")
        if self.limits_at is not None:
            raise ValueError("limits_at belongs to a path, not to two states")
        if self.timing.method != "jerk_limited" and "method" in self.timing.model_fields_set:
            raise ValueError("between two states timing.method can only be jerk_limited")
        for name in sorted(self.timing.model_fields_set - _STATE_TIMING):
            if getattr(self.timing, name) is not None:
                raise ValueError(f"timing.{name} belongs to a path, not to two states")
        return self


class RetimeAnswer(Answer):
    """A timed path, and what was proved of its limits."""

    status: Literal["success", "unverified"]
    """success where the certificate is verified; unverified where times or states that were given
    break limits, or nothing is known of them
    """
    trajectory: TrajectoryAnswer
    certificate: CertificateAnswer
    """of the limits alone; not verified where times that were given break them"""
    factor: float
    """times that were given were stretched by this"""
    needed_factor: float | None
    """times have to be stretched by this for all limits to hold; 1 if they do, null where no
    stretching cures what is wrong: outside a joint's range, or a jump
    """
    timing: TimingAnswer | None = None
    """method and limits of its timing"""
    notes: list[str] = Field(default_factory=list)
    """what is special about the path"""
    peaks: dict[str, list[float]] = Field(default_factory=dict)
    """exact largest |velocity|, |acceleration| and |jerk| of each joint; jerk within the pieces"""


class ConvertRequest(Body):
    """A motion to be told in another shape."""

    trajectory: TrajectoryBody
    sample_period: Annotated[NonNegative, Field(ge=1e-4, le=60.0)] = Field(examples=[0.01])
    """time between samples [s]"""
    format: Literal["joint_trajectory", "csv"] = "joint_trajectory"
    """the message trajectory_msgs/JointTrajectory as JSON, or a table"""
    frame_id: Annotated[str, Field(max_length=256)] = ""
    """of the message's header"""

    @model_validator(mode="after")
    def _check_form(self) -> "ConvertRequest":
        if self.trajectory.joint_names is None:
            raise ValueError("trajectory.joint_names are needed: the columns are named by them")
        return self


class JointTrajectoryAnswer(Answer):
    """The message trajectory_msgs/JointTrajectory."""

    header: dict[str, Any]
    """with `stamp` and `frame_id`"""
    joint_names: list[str]
    """names of the columns"""
    points: list[dict[str, Any]]
    """positions, velocities and accelerations with `time_from_start`"""


class TipTolerance(Body):
    """Largest distance of the tool from where a path leads it, at every place."""

    position: Positive | None = None
    """of the tip's origin [m]"""
    orientation: Positive | None = None
    """angle of the tip [rad]"""


#: Fields that mean nothing without a robot.
_OF_ROBOT = (
    "tool_tolerance",
    "scene",
    "frame",
    "attached",
    "allowed_collisions",
    "fingers",
    "tool",
    "tcp",
)


class SimplifyRequest(SceneRequest, WithFingers, BodyWithRules):
    """A path to be told by the fewest waypoints within a tolerance, in a scene perhaps."""

    needs: ClassVar[Beside] = dict.fromkeys(_OF_ROBOT, ("robot",))

    model_config = ConfigDict(json_schema_extra={"examples": examples("SimplifyRequest")})

    path: PathBody
    tolerance: NonNegative | None = Field(None, examples=[0.001])
    """largest distance of any joint from the path, at every place [rad or m]; may be left out
    beside tool_tolerance
    """
    tool_tolerance: TipTolerance | None = None
    """largest distance of the tool at every place, by the longest arms of the joints; with a robot
    """
    robot: Name | None = Field(None, examples=["panda"])
    """name of a stored or built-in robot, against which the answer is proved"""


class SimplifyAnswer(Answer):
    """The fewest waypoints within the tolerance, and what was proved of the lines between."""

    status: Literal["success", "unverified"]
    """success; unverified where a robot is named and the lines are not proved"""
    joints: list[list[float]]
    """waypoints that stay [rad or m]"""
    waypoints: list[int]
    """their numbers in the path given, from 0"""
    left_out: int
    """number of waypoints that are left out"""
    deviation: float
    """bound of the distance of any joint from the path, at every place [rad or m]"""
    tool_deviation: dict[str, float | None] | None = None
    """bounds of the tool's position [m] and orientation [rad], null for one without a tolerance;
    null without tool_tolerance
    """
    certificate: CertificateAnswer | None = None
    """of positions and collisions, with a robot; leg i is run through from rest to rest from the
    time i - 1 to i
    """
    notes: list[str] = Field(default_factory=list)
    """what is special about the path"""


_TIMES = is_given("times") | {"type": "object"}


class FitRequest(WithTool, BodyWithRules):
    """A recorded motion that few polynomials are to stand for."""

    needs: ClassVar[Beside] = {"tool": ("robot",), "tcp": ("robot",), "limits": ("retime",)}
    published_rules = ({"not": {"required": ["retime"], "properties": {"retime": _TIMES}}},)

    model_config = ConfigDict(json_schema_extra={"examples": examples("FitRequest")})

    samples: Samples
    """times and positions; between samples joints move evenly, velocities and accelerations are not
    read
    """
    joint_names: Names | None = None
    """where no robot is named"""
    tolerance: Positive
    """largest distance of any joint from the record, at every instant [rad or m]"""
    robot: Name | None = None
    """name of a stored or built-in robot, against which the answer is proved"""
    rest: bool = False
    """begin and end without velocity"""
    retime: RetimeTiming | None = Field(None, examples=[{}, {"velocity_scaling": 0.5}])
    """keep the record's geometry and time it anew by these options, from rest to rest, as retime
    does; left out, its times are kept
    """
    limits: LimitsBody | None = None
    """for retime, where no robot is named or in place of its own"""
    timeout: Timeout | None = None

    @model_validator(mode="after")
    def _check_form(self) -> "FitRequest":
        if self.retime is not None and self.retime.times is not None:
            raise ValueError("retime.times: leave retime out to keep the times of the samples")
        return self


class FitAnswer(Answer):
    """Polynomials that stand for a recorded motion: its own times, or timed anew."""

    status: Literal["success", "unverified"]
    """success; unverified where a robot is named and the motion is not proved"""
    trajectory: TrajectoryAnswer
    deviation: float
    """bound of the distance of any joint at every instant; timed anew, at every place, both run
    through in the same order [rad or m]
    """
    certificate: CertificateAnswer | None = None
    """with a robot: of its limits, and of collisions with itself; without one of limits given"""
    timing: TimingAnswer | None = None
    """method and limits, where it is timed anew"""
    notes: list[str] = Field(default_factory=list)
    """what is special about the path then"""
