"""Paths of fewer waypoints on the wire."""

from typing import Literal

from pydantic import ConfigDict, Field, model_validator

from armwright_wire.base import Answer, Frame, Name, NonNegative, Positive, Timeout, examples
from armwright_wire.motions.certificate import CertificateAnswer
from armwright_wire.motions.retime import Names, PathBody
from armwright_wire.motions.trajectory import Samples, TrajectoryAnswer
from armwright_wire.scenes.check import AllowedCollisions, AttachedObjects, Margin, WithFingers
from armwright_wire.scenes.scene import SceneReference
from armwright_wire.scenes.tool import WithTool

#: Fields that mean nothing without a robot.
_OF_ROBOT = ("scene", "frame", "attached", "allowed_collisions", "fingers", "tool", "tcp")


class SimplifyRequest(WithTool, WithFingers):
    """A path to be told by the fewest waypoints within a tolerance, in a scene perhaps."""

    model_config = ConfigDict(json_schema_extra={"examples": examples("SimplifyRequest")})

    path: PathBody
    tolerance: NonNegative = Field(
        description="largest distance of any joint from the path, at every place [rad or m]",
        examples=[0.001],
    )
    robot: Name | None = Field(
        None,
        examples=["panda"],
        description="name of a stored or built-in robot, against which the answer is proved",
    )
    scene: SceneReference | None = Field(None, examples=["table"])
    frame: Frame | None = None
    attached: AttachedObjects | None = None
    allowed_collisions: AllowedCollisions | None = None
    margin: Margin = 0.0
    timeout: Timeout | None = None

    @model_validator(mode="after")
    def _check_robot(self) -> "SimplifyRequest":
        if self.robot is None:
            for name in _OF_ROBOT:
                if getattr(self, name) is not None:
                    raise ValueError(f"{name} needs a robot: name one, or leave {name} out")
        return self


class SimplifyAnswer(Answer):
    """The fewest waypoints within the tolerance, and what was proved of the lines between."""

    status: Literal["success", "unverified"] = Field(
        description="success; unverified where a robot is named and the lines are not proved"
    )
    joints: list[list[float]] = Field(description="waypoints that stay [rad or m]")
    waypoints: list[int] = Field(description="their numbers in the path given, from 0")
    left_out: int = Field(description="number of waypoints that are left out")
    deviation: float = Field(
        description="bound of the distance of any joint from the path, at every place [rad or m]"
    )
    certificate: CertificateAnswer | None = Field(
        None,
        description="of positions and collisions, with a robot; leg i is run through from rest to "
        "rest from the time i - 1 to i",
    )
    notes: list[str] = Field(default_factory=list, description="what is special about the path")


class FitRequest(WithTool):
    """A recorded motion that few polynomials are to stand for."""

    model_config = ConfigDict(json_schema_extra={"examples": examples("FitRequest")})

    samples: Samples = Field(
        description="times and positions; between samples joints move evenly, velocities and "
        "accelerations are not read"
    )
    joint_names: Names | None = Field(None, description="where no robot is named")
    tolerance: Positive = Field(
        description="largest distance of any joint from the record, at every instant [rad or m]"
    )
    robot: Name | None = Field(
        None, description="name of a stored or built-in robot, against which the answer is proved"
    )
    rest: bool = Field(False, description="begin and end without velocity")
    timeout: Timeout | None = None

    @model_validator(mode="after")
    def _check_robot(self) -> "FitRequest":
        if self.robot is None and (self.tool, self.tcp) != (None, None):
            raise ValueError("a tool needs a robot: name one, or leave the tool out")
        return self


class FitAnswer(Answer):
    """Cubics with continuous accelerations that stand for a recorded motion."""

    status: Literal["success", "unverified"] = Field(
        description="success; unverified where a robot is named and the motion is not proved"
    )
    trajectory: TrajectoryAnswer
    deviation: float = Field(
        description="bound of the distance of any joint at every instant [rad or m]"
    )
    certificate: CertificateAnswer | None = Field(
        None, description="with a robot: of its limits, and of collisions with itself"
    )
