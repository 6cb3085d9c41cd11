"""Timing of given paths, and motions in other people's shapes, on the wire."""

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, model_validator
from pydantic.config import JsonDict

from armwright_wire.base import (
    MAX_JOINTS,
    Answer,
    Body,
    JointVector,
    Label,
    Name,
    NonNegative,
    Number,
    Positive,
    Timeout,
    examples,
)
from armwright_wire.motions.certificate import CertificateAnswer
from armwright_wire.motions.timing import Timing, TimingAnswer
from armwright_wire.motions.trajectory import LimitsBody, TrajectoryAnswer, TrajectoryBody
from armwright_wire.scenes.tool import WithTool

#: A path of so many waypoints takes some seconds.
MAX_WAYPOINTS = 20_000

Waypoints = Annotated[list[JointVector], Field(min_length=1, max_length=MAX_WAYPOINTS)]
Names = Annotated[list[Label], Field(min_length=1, max_length=MAX_JOINTS)]


#: Options of the timing between two states.
_STATE_TIMING = {
    "method",
    "velocity_scaling",
    "acceleration_scaling",
    "jerk_scaling",
    "sample_period",
}


class PathBody(Body):
    """Waypoints in joint space."""

    joints: Waypoints = Field(description="waypoints in their order [rad or m]")
    joint_names: Names | None = Field(None, description="where no robot is named")


class RetimePath(PathBody):
    """Waypoints in joint space, and what is to lead through them or near them."""

    tolerance: Positive | None = Field(
        None,
        description="how far the motion may be from the straight lines through the waypoints, in "
        "any joint at every place: few of them, or a smooth curve, stand for all [rad or m]",
        examples=[0.001],
    )
    knots: Annotated[list[Number], Field(min_length=2, max_length=MAX_WAYPOINTS)] | None = Field(
        None, description="of a spline, strictly increasing; times for the method spline [s]"
    )


class RetimeTiming(Timing):
    """Options of the timing."""

    times: Annotated[list[Number], Field(min_length=2, max_length=MAX_WAYPOINTS)] | None = Field(
        None,
        description="at the waypoints, for the method spline; increasing from any number [s]. "
        "Limits that are not known are not needed then: the motion's peaks are reported",
    )
    start_velocity: JointVector | None = Field(
        None,
        description="along the path; at rest if left out. A spline with times takes any: this end "
        "is clamped to it, of natural_spline too, whose other end stays natural",
    )
    end_velocity: JointVector | None = Field(None, description="likewise, at the end")


class JointStateBody(Body):
    """Position, velocity and acceleration of all joints."""

    position: JointVector = Field(description="[rad or m]")
    velocity: JointVector | None = Field(None, description="at rest if left out [rad/s or m/s]")
    acceleration: JointVector | None = Field(None, description="zero if left out [rad/s² or m/s²]")


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
        None, alias="from", description="in place of a path: the state to begin with"
    )
    end: JointStateBody | None = Field(
        None, alias="to", description="in place of a path: the state to end with"
    )
    joint_names: Names | None = Field(
        None, description="of the two states, where no robot is named"
    )
    synchronization: Literal["phase", "time"] | None = Field(
        None,
        description="of the joints between two states: phase (if left out) for a straight line "
        "where the states allow one, time for arriving together only",
    )
    robot: Name | None = Field(
        None,
        examples=["panda"],
        description="name of a stored or built-in robot, whose limits hold where none are given",
    )
    limits: LimitsBody | None = None
    timing: RetimeTiming = Field(default_factory=RetimeTiming)
    stops: Literal["none", "path"] = Field(
        "none",
        description="path: prove that the arm can come to rest along its path from every instant; "
        "stops of single joints leave it, plan and validate prove these",
    )
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
        if self.timing.method != "jerk_limited" and "method" in self.timing.model_fields_set:
            raise ValueError("between two states timing.method can only be jerk_limited")
        for name in sorted(self.timing.model_fields_set - _STATE_TIMING):
            if getattr(self.timing, name) is not None:
                raise ValueError(f"timing.{name} belongs to a path, not to two states")
        return self


class RetimeAnswer(Answer):
    """A timed path, and what was proved of its limits."""

    status: Literal["success", "unverified"] = Field(
        description="success where the certificate is verified; unverified where times or states "
        "that were given break limits, or nothing is known of them"
    )
    trajectory: TrajectoryAnswer
    certificate: CertificateAnswer = Field(
        description="of the limits alone; not verified where times that were given break them"
    )
    factor: float = Field(description="times that were given were stretched by this")
    needed_factor: float | None = Field(
        description="times have to be stretched by this for all limits to hold; 1 if they do, null "
        "where no stretching cures what is wrong: outside a joint's range, or a jump"
    )
    timing: TimingAnswer | None = Field(None, description="method and limits of its timing")
    notes: list[str] = Field(default_factory=list, description="what is special about the path")
    peaks: dict[str, list[float]] = Field(
        default_factory=dict,
        description="exact largest |velocity|, |acceleration| and |jerk| of each joint; jerk "
        "within the pieces",
    )


class ConvertRequest(Body):
    """A motion to be told in another shape."""

    trajectory: TrajectoryBody
    sample_period: Annotated[NonNegative, Field(ge=1e-4, le=60.0)] = Field(
        examples=[0.01], description="time between samples [s]"
    )
    format: Literal["joint_trajectory", "csv"] = Field(
        "joint_trajectory",
        description="the message trajectory_msgs/JointTrajectory as JSON, or a table",
    )
    frame_id: Annotated[str, Field(max_length=256)] = Field(
        "", description="of the message's header"
    )

    @model_validator(mode="after")
    def _check_form(self) -> "ConvertRequest":
        if self.trajectory.joint_names is None:
            raise ValueError("trajectory.joint_names are needed: the columns are named by them")
        return self


class JointTrajectoryAnswer(Answer):
    """The message trajectory_msgs/JointTrajectory."""

    header: dict[str, Any] = Field(description="with `stamp` and `frame_id`")
    joint_names: list[str] = Field(description="names of the columns")
    points: list[dict[str, Any]] = Field(
        description="positions, velocities and accelerations with `time_from_start`"
    )
