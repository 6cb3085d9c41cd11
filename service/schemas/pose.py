"""Poses on the wire."""

import math
from collections.abc import Callable
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, field_validator, model_validator
from pydantic.config import JsonDict

from kinematics.errors import InvalidPose
from kinematics.rounding import check_axis_length, check_quaternion_norm, check_rotation
from service.schemas.base import (
    Answer,
    Body,
    Coordinate,
    Frame,
    Matrix3,
    Number,
    Point,
    Vector3,
    any_given,
)

Quaternion = Annotated[list[Number], Field(min_length=4, max_length=4)]
AxisAngle = Annotated[list[Number], Field(min_length=4, max_length=4)]
#: Forms of an orientation on the wire.
ORIENTATIONS = ("quaternion_xyzw", "rotation_matrix", "euler_zyz", "rpy", "axis_angle")


_Row4 = Annotated[list[Number], Field(min_length=4, max_length=4)]
Matrix4 = Annotated[list[_Row4], Field(min_length=4, max_length=4)]


class Pose(Body):
    """A position [m] and at most one orientation, the identity if left out; or a transform."""

    published_rules: ClassVar[tuple[JsonDict, ...]] = (any_given(("position",), ("transform",)),)
    #: Whether a pose without a position is at the origin.
    may_lack_position: ClassVar[bool] = False

    position: Point = Field(
        default_factory=lambda: [0.0, 0.0, 0.0],
        examples=[[0.4, 0.0, 0.3]],
        description="x, y, z [m]; needed beside all but a transform",
    )
    quaternion_xyzw: Quaternion | None = Field(
        None,
        examples=[[0.0, 0.0, 0.0, 1.0]],
        description="normalised if its norm is within 1e-3 of 1, else refused",
    )
    rotation_matrix: Matrix3 | None = Field(
        None,
        description="rows; of a rotation within rounding to three digits or more the nearest one "
        "is taken, others are refused",
    )
    euler_zyz: Vector3 | None = Field(None, description="[phi, theta, psi], R = Rz Ry Rz [rad]")
    rpy: Vector3 | None = Field(None, description="[roll, pitch, yaw], R = Rz Ry Rx [rad]")
    axis_angle: AxisAngle | None = Field(
        None, description="[x, y, z, angle]: about an axis of any length but 0, by an angle [rad]"
    )
    transform: Matrix4 | None = Field(
        None, description="rows of [[R, p], [0, 0, 0, 1]], in place of all other forms"
    )

    @field_validator("quaternion_xyzw")
    @classmethod
    def _check_quaternion(cls, value: list[float] | None) -> list[float] | None:
        if value is not None:
            _check(lambda: check_quaternion_norm(math.hypot(*value)))
        return value

    @field_validator("rotation_matrix")
    @classmethod
    def _check_matrix(cls, value: list[list[float]] | None) -> list[list[float]] | None:
        if value is not None:
            _check(lambda: check_rotation(value))
        return value

    @field_validator("axis_angle")
    @classmethod
    def _check_axis_angle(cls, value: list[float] | None) -> list[float] | None:
        if value is not None:
            _check(lambda: check_axis_length(math.hypot(*value[:3])))
        return value

    @field_validator("transform")
    @classmethod
    def _check_transform(cls, value: list[list[float]] | None) -> list[list[float]] | None:
        if value is not None:
            if value[3] != [0.0, 0.0, 0.0, 1.0]:
                raise ValueError("the last row of a transform is 0, 0, 0, 1")
            _check(lambda: check_rotation([row[:3] for row in value[:3]]))
        return value

    @model_validator(mode="after")
    def _check_form(self) -> Self:
        if self.transform is None and len(self.model_fields_set) <= 2 and self._has_position:
            return self  # most of hundreds: a position, and one more perhaps
        given = [name for name in ORIENTATIONS if getattr(self, name) is not None]
        if self.transform is not None:
            if given or any(self.position):
                raise ValueError("transform holds position and orientation; leave all others out")
            # One form less for all that reads poses.
            values = vars(self)
            values["position"] = [row[3] for row in self.transform[:3]]
            values["rotation_matrix"] = [row[:3] for row in self.transform[:3]]
            values["transform"] = None
            self.model_fields_set.update(("position", "rotation_matrix"))
        elif not self._has_position:
            raise ValueError("a pose needs a position or a transform")
        if len(given) > 1:
            raise ValueError(f"give at most one orientation; found {' and '.join(given)}")
        return self

    @property
    def _has_position(self) -> bool:
        return self.may_lack_position or "position" in self.model_fields_set


class FramedPose(Pose):
    """A pose in the robot's root frame, or in one that it names."""

    frame: Frame | None = None


def _check(judge: Callable[[], Any]) -> None:
    try:
        judge()
    except InvalidPose as error:
        raise ValueError(f"{error.message}. {error.hint or ''}".rstrip()) from error


Orientation = Literal["quaternion_xyzw", "rotation_matrix", "euler_zyz", "rpy", "axis_angle"]


class PoseAnswer(Answer):
    """A pose in the robot's root frame."""

    position: list[Coordinate] = Field(examples=[[0.4, 0.0, 0.3]], description="x, y, z [m]")
    quaternion_xyzw: list[float] = Field(
        examples=[[0.0, 0.0, 0.0, 1.0]], description="orientation as x, y, z, w"
    )


class OrientedPoseAnswer(Answer):
    """A pose with its orientation in the form that was asked for."""

    position: list[float] = Field(examples=[[0.4, 0.0, 0.3]], description="x, y, z [m]")
    quaternion_xyzw: list[float] | None = Field(
        None, examples=[[0.0, 0.0, 0.0, 1.0]], description="orientation as x, y, z, w"
    )
    rotation_matrix: list[list[float]] | None = Field(None, description="rows")
    euler_zyz: list[float] | None = Field(
        None, description="[phi, theta, psi] [rad], theta in [0, pi]; psi = 0 where sin(theta) = 0"
    )
    rpy: list[float] | None = Field(
        None,
        description="[roll, pitch, yaw] [rad], pitch in [-pi/2, pi/2]; roll = 0 at its ends",
    )
    axis_angle: list[float] | None = Field(
        None,
        description="[x, y, z, angle]: a unit axis, the angle [rad] in [0, pi]; z where it is 0",
    )
