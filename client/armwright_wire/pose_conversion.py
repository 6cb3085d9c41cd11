"""Conversion and composition of poses on the wire."""

from typing import Annotated, ClassVar, Literal

from pydantic import ConfigDict, Field, model_validator
from pydantic.config import JsonDict

from armwright_wire.base import Answer, Body, Vector3, exactly_one
from armwright_wire.pose import Pose

#: Motions that one request composes.
MAX_MOTIONS = 1_000

_EXAMPLE: JsonDict = {
    "motions": [
        {"axis_angle": [0.0, 0.0, 1.0, 1.5707963267948966]},
        {"axis_angle": [1.0, 0.0, 0.0, 1.5707963267948966], "about": "current"},
        {"position": [0.0, 0.0, 0.5], "about": "fixed"},
    ],
    "angular_velocity": [0.0, 0.0, 1.0],
}


class PoseForm(Pose):
    """A pose in any form; a position that is left out is the origin."""

    published_rules: ClassVar[tuple[JsonDict, ...]] = ()
    may_lack_position: ClassVar[bool] = True


class Motion(PoseForm):
    """A rigid motion of a list that is carried out in turn."""

    about: Literal["current", "fixed"] = Field(
        "current",
        description="current: about the axes of the moved frame, T <- T T_i; fixed: about those "
        "of the first one, T <- T_i T",
    )


class ConvertPoseRequest(Body):
    """A pose, or motions to be composed, to be answered in every form."""

    one_of: ClassVar[tuple[str, ...]] = ("pose", "motions")

    model_config = ConfigDict(json_schema_extra={"examples": [_EXAMPLE]})

    pose: PoseForm | None = None
    motions: Annotated[list[Motion], Field(min_length=1, max_length=MAX_MOTIONS)] | None = Field(
        None, description="carried out in turn, beginning at the identity"
    )
    inverse: bool = Field(False, description="invert the pose before it is answered")
    angular_velocity: Vector3 | None = Field(
        None, description="ω in the outer frame [rad/s]; S(ω) and the rotation's rate S(ω) R follow"
    )

    @model_validator(mode="after")
    def _check_form(self) -> "ConvertPoseRequest":
        exactly_one(self, self.one_of)
        return self


class PoseForms(Answer):
    """A pose in every form."""

    position: list[float] = Field(description="x, y, z [m]")
    quaternion_xyzw: list[float] = Field(description="with w >= 0; its negative means the same")
    rotation_matrix: list[list[float]] = Field(description="rows")
    euler_zyz: list[float] = Field(description="[phi, theta, psi] [rad], theta in [0, pi]")
    rpy: list[float] = Field(description="[roll, pitch, yaw] [rad], pitch in [-pi/2, pi/2]")
    axis_angle: list[float] = Field(
        description="[x, y, z, angle]: a unit axis, angle [rad] in [0, pi]"
    )
    transform: list[list[float]] = Field(description="rows of [[R, p], [0, 0, 0, 1]]")
    euler_zyz_branches: list[list[float]] = Field(
        description="both branches, that of theta in [0, pi] first; one where sin(theta) = 0"
    )
    rpy_branches: list[list[float]] = Field(
        description="both branches, that of pitch in [-pi/2, pi/2] first; one where cos(pitch) = 0"
    )


class SingularFormAnswer(Answer):
    """A form of the orientation that does not determine all of its numbers."""

    form: Literal["euler_zyz", "rpy", "axis_angle"] = Field(description="of the orientation")
    determined: str = Field(
        examples=["theta = 0: only phi + psi is determined"],
        description="what the rotation determines",
    )
    choice: str = Field(description="made for the rest", examples=["psi = 0"])


class ConvertPoseAnswer(Answer):
    """A pose in every form, its inverse, and where its angles are singular."""

    pose: PoseForms
    inverse: PoseForms
    singular: list[SingularFormAnswer] = Field(
        description="forms that do not determine all of their numbers"
    )
    notes: list[str] = Field(default_factory=list, description="what was done to the request")
    poses: list[list[list[float]]] | None = Field(
        None, description="of motions: the 4x4 transform after each"
    )
    skew: list[list[float]] | None = Field(None, description="S(ω), with S(ω) v = ω × v")
    rotation_rate: list[list[float]] | None = Field(None, description="dR/dt = S(ω) R [1/s]")
