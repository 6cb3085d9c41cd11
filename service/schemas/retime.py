"""Timing of given paths, and motions in other people's shapes, on the wire."""

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, model_validator
from pydantic.config import JsonDict

from service.schemas.base import (
    MAX_JOINTS,
    Answer,
    Body,
    JointVector,
    Label,
    Name,
    NonNegative,
    Number,
    Timeout,
)
from service.schemas.certificate import CertificateAnswer, TrajectoryAnswer
from service.schemas.plan import LimitsBody, Timing, TrajectoryBody

#: A path of so many waypoints takes some seconds.
MAX_WAYPOINTS = 5_000

Waypoints = Annotated[list[JointVector], Field(min_length=1, max_length=MAX_WAYPOINTS)]
Names = Annotated[list[Label], Field(min_length=1, max_length=MAX_JOINTS)]

_EXAMPLE: JsonDict = {
    "path": {"joints": [[0.0, 0.0], [1.0, 0.2], [1.2, 1.0]]},
    "limits": {"velocity": [1.0, 1.0], "acceleration": [4.0, 4.0], "jerk": [40.0, 40.0]},
    "timing": {"method": "jerk_limited", "blend_tolerance": 0.05, "sample_period": 0.01},
}

_TOPPRA: JsonDict = {
    "path": {"joints": [[0.0, 0.0], [1.0, 0.2], [1.2, 1.0]]},
    "limits": {"velocity": [1.0, 1.0], "acceleration": [4.0, 4.0]},
    "timing": {"method": "toppra", "solver": "toppra", "interpolation": "natural_spline"},
}


class RetimePath(Body):
    """Waypoints in joint space, and what a spline through them is to have for knots."""

    joints: Waypoints
    knots: Annotated[list[Number], Field(min_length=2, max_length=MAX_WAYPOINTS)] | None = Field(
        None, description="of a spline, strictly increasing; times for the method spline [s]"
    )
    joint_names: Names | None = Field(None, description="where no robot is named")


class RetimeTiming(Timing):
    """Options of the timing."""

    start_velocity: JointVector | None = Field(
        None, description="along the path; at rest if left out"
    )
    end_velocity: JointVector | None = Field(
        None, description="along the path; at rest if left out"
    )


class RetimeRequest(Body):
    """A path to be timed within a robot's limits, or those given."""

    model_config = ConfigDict(json_schema_extra={"examples": [_EXAMPLE, _TOPPRA]})

    path: RetimePath
    robot: Name | None = Field(None, examples=["panda"])
    limits: LimitsBody | None = None
    timing: RetimeTiming = Field(default_factory=RetimeTiming)
    timeout: Timeout | None = None


class RetimeAnswer(Answer):
    """A timed path, and what was proved of its limits."""

    status: Literal["success"]
    trajectory: TrajectoryAnswer
    certificate: CertificateAnswer = Field(
        description="of the limits alone; not verified where times that were given break them"
    )
    factor: float = Field(description="times that were given were stretched by this")
    needed_factor: float = Field(
        description="times have to be stretched by this for all limits to hold; 1 if they do"
    )
    notes: list[str] = Field(default_factory=list, description="what is special about the path")


class ConvertRequest(Body):
    """A motion to be told in another shape."""

    trajectory: TrajectoryBody
    sample_period: Annotated[NonNegative, Field(ge=1e-4, le=60.0)] = Field(examples=[0.01])
    format: Literal["joint_trajectory", "csv"] = "joint_trajectory"
    frame_id: Annotated[str, Field(max_length=256)] = ""

    @model_validator(mode="after")
    def _check_form(self) -> "ConvertRequest":
        if self.trajectory.joint_names is None:
            raise ValueError("trajectory.joint_names are needed: the columns are named by them")
        return self


class JointTrajectoryAnswer(Answer):
    """The message trajectory_msgs/JointTrajectory."""

    header: dict[str, Any]
    joint_names: list[str]
    points: list[dict[str, Any]]
