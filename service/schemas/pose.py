"""Poses on the wire."""

import math
from collections.abc import Callable
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from kinematics.errors import InvalidPose
from kinematics.rotation_check import (
    check_axis_length,
    check_orthonormal,
    check_quaternion_norm,
)
from service.schemas.base import (
    Answer,
    Body,
    Coordinate,
    Frame,
    Matrix3,
    Number,
    Point,
    Vector3,
)

Quaternion = Annotated[list[Number], Field(min_length=4, max_length=4)]
AxisAngle = Annotated[list[Number], Field(min_length=4, max_length=4)]
#: Forms of an orientation on the wire.
ORIENTATIONS = ("quaternion_xyzw", "rotation_matrix", "euler_zyz", "rpy", "axis_angle")


class Pose(Body):
    """A position [m] and at most one orientation; no orientation means the identity."""

    position: Point = Field(examples=[[0.4, 0.0, 0.3]], description="x, y, z [m]")
    quaternion_xyzw: Quaternion | None = Field(
        None,
        examples=[[0.0, 0.0, 0.0, 1.0]],
        description="normalised if its norm is within 1e-3 of 1, else refused",
    )
    rotation_matrix: Matrix3 | None = Field(
        None, description="rows; orthonormal within 1e-6 and of determinant +1, else refused"
    )
    euler_zyz: Vector3 | None = Field(None, description="[phi, theta, psi], R = Rz Ry Rz [rad]")
    rpy: Vector3 | None = Field(None, description="[roll, pitch, yaw], R = Rz Ry Rx [rad]")
    axis_angle: AxisAngle | None = Field(
        None, description="[x, y, z, angle]: about an axis of any length but 0, by an angle [rad]"
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
            _check(lambda: _check_rotation(value))
        return value

    @field_validator("axis_angle")
    @classmethod
    def _check_axis_angle(cls, value: list[float] | None) -> list[float] | None:
        if value is not None:
            _check(lambda: check_axis_length(math.hypot(*value[:3])))
        return value

    @model_validator(mode="after")
    def _check_one_orientation(self) -> "Pose":
        if len(self.model_fields_set) <= 2:  # most of hundreds: a position, and one more perhaps
            return self
        given = [name for name in ORIENTATIONS if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f"give at most one orientation; found {' and '.join(given)}")
        return self


class FramedPose(Pose):
    """A pose in the robot's root frame, or in one that it names."""

    frame: Frame | None = None


# Without numpy, which the server does not load for this.
def _check_rotation(R: list[list[float]]) -> None:
    error = max(
        abs(sum(R[k][i] * R[k][j] for k in range(3)) - (i == j)) for i in range(3) for j in range(3)
    )
    determinant = sum(
        R[0][i] * (R[1][(i + 1) % 3] * R[2][(i + 2) % 3] - R[1][(i + 2) % 3] * R[2][(i + 1) % 3])
        for i in range(3)
    )
    check_orthonormal(error, determinant)


def _check(judge: Callable[[], None]) -> None:
    try:
        judge()
    except InvalidPose as error:
        raise ValueError(error.message) from error


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
