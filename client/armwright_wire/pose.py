"""Poses on the wire, their conversion and composition."""

import math
from collections.abc import Callable, Sequence
from decimal import Decimal
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, TypeAlias

from pydantic import AfterValidator, ConfigDict, Field, model_validator
from pydantic.config import JsonDict

from armwright_wire.base import (
    AS_LIST,
    Answer,
    Body,
    BodyWithRules,
    Coordinate,
    Frame,
    Matrix3,
    Number,
    Point,
    RowsLike,
    Vector3,
    VectorLike,
    as_json,
    examples,
    is_given,
)

Quaternion = Annotated[Sequence[Number], AS_LIST, Field(min_length=4, max_length=4)]
Matrix4 = Annotated[Sequence[Quaternion], AS_LIST, Field(min_length=4, max_length=4)]
#: Forms of an orientation on the wire.
ORIENTATIONS = ("quaternion_xyzw", "rotation_matrix", "euler_zyz", "rpy", "axis_angle")


# The rules of rounding below are those of `kinematics.rounding`, which no client has; tests compare
# the two.
_NORM_TOLERANCE = 1e-3
_ORTHONORMAL_TOLERANCE = 1e-6
_SHORTEST_AXIS = 1e-12
_FEWEST_DIGITS = 3


def check_quaternion_norm(quaternion: Sequence[float]) -> None:
    """Refuse a quaternion by its norm.

    Raises:
        ValueError: The norm differs from 1 by more than 1e-3.
    """
    norm = math.hypot(*quaternion)
    if not abs(norm - 1.0) <= _NORM_TOLERANCE:
        raise ValueError(
            f"quaternion_xyzw has norm {norm:.6g}; it must be within {_NORM_TOLERANCE} of 1. "
            "Normalise it; the order is [x, y, z, w]."
        )


def check_axis_length(axis: Sequence[float]) -> None:
    """Refuse an axis by its length; an angle may stand behind it.

    Raises:
        ValueError: The axis has no direction.
    """
    if not math.hypot(*axis[:3]) >= _SHORTEST_AXIS:
        raise ValueError("the axis has length 0, so it names no direction.")


def check_rotation(rows: Sequence[Sequence[float]]) -> None:
    """Refuse a matrix R that is no rotation within the rounding of its entries.

    Args:
        rows: Shape (3, 3).

    Raises:
        ValueError: R^T R differs from I by more than that and more than 1e-6, or det R is not +1.
    """
    (a, b, c), (d, e, f), (g, h, i) = rows
    columns = ((a, d, g), (b, e, h), (c, f, i))
    errors = {
        (k, m): sum(x * y for x, y in zip(columns[k], columns[m], strict=True)) - float(k == m)
        for k in range(3)
        for m in range(k, 3)
    }
    error = max(map(abs, errors.values()))
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    if determinant > 0.0 and error <= 1.0:
        # Entries near 1 are written 0.9999 or 1: digits count as decimals.
        written = (Decimal(repr(float(x))).normalize() for x in (a, b, c, d, e, f, g, h, i)
                   if abs(x) >= _SHORTEST_AXIS)  # fmt: skip
        digits = max((_FEWEST_DIGITS, *(len(x.as_tuple().digits) for x in written)))
        u = 0.5 * 10.0**-digits
        sizes = [sum(map(abs, column)) for column in columns]
        if error <= _ORTHONORMAL_TOLERANCE or all(
            abs(x) <= u * (sizes[k] + sizes[m]) + 3.0 * u * u for (k, m), x in errors.items()
        ):
            return
    raise ValueError(
        f"rotation_matrix is not a rotation: R^T R differs from I by {error:.3g}, "
        f"det R = {determinant:.6g}. Give an orthonormal matrix with determinant +1, row by row, "
        "with three decimals or more, or give quaternion_xyzw or rpy."
    )


def _check_transform(rows: Sequence[Sequence[float]]) -> None:
    if rows[3] != [0.0, 0.0, 0.0, 1.0]:
        raise ValueError("the last row of a transform is 0, 0, 0, 1")
    check_rotation([row[:3] for row in rows[:3]])


def _checked(check: Callable[[Any], None]) -> AfterValidator:
    def checked(value: Any) -> Any:
        check(value)
        return value

    return AfterValidator(checked)


class Pose(Body):
    """A position [m] and at most one orientation, the identity if left out; or a transform."""

    published_rules: ClassVar[tuple[JsonDict, ...]] = (
        {"oneOf": [{"required": ["position"], "not": is_given("transform")},
                   is_given("transform") | {"not": {"required": ["position"]}}]},
    )  # fmt: skip
    at_most_one = ((*ORIENTATIONS, "transform"),)
    goes_by_fields: ClassVar[bool] = True
    #: Whether a pose without a position is at the origin.
    may_lack_position: ClassVar[bool] = False

    position: Point = Field(default_factory=lambda: [0.0, 0.0, 0.0], examples=[[0.4, 0.0, 0.3]])
    """x, y, z [m]; needed beside all but a transform"""
    quaternion_xyzw: Annotated[Quaternion, _checked(check_quaternion_norm)] | None = Field(
        None, examples=[[0.0, 0.0, 0.0, 1.0]]
    )
    """normalised if its norm is within 1e-3 of 1, else refused"""
    rotation_matrix: Annotated[Matrix3, _checked(check_rotation)] | None = None
    """rows; of a rotation within rounding to three digits or more the nearest one is taken, others
    are refused
    """
    euler_zyz: Vector3 | None = None
    """[phi, theta, psi], R = Rz Ry Rz [rad]"""
    rpy: Vector3 | None = None
    """[roll, pitch, yaw], R = Rz Ry Rx [rad]"""
    axis_angle: Annotated[Quaternion, _checked(check_axis_length)] | None = None
    """[x, y, z, angle]: about an axis of any length but 0, by an angle [rad]"""
    transform: Annotated[Matrix4, _checked(_check_transform)] | None = None
    """rows of [[R, p], [0, 0, 0, 1]], in place of all other forms"""

    @model_validator(mode="after")
    def _check_form(self) -> Self:
        others = self.model_fields_set - {"position"}
        if self.transform is None and len(others) <= 1 and self._has_position:
            return self  # most of hundreds: a position, and one more perhaps
        given = [name for name in ORIENTATIONS if getattr(self, name) is not None]
        if self.transform is not None:
            if given or "position" in self.model_fields_set:
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

    @classmethod
    def at(cls, x: float, y: float, z: float) -> Self:
        """The pose at a position [m] with the axes of the root frame."""
        return cls(position=[x, y, z])

    @classmethod
    def from_quaternion(cls, position: VectorLike, xyzw: VectorLike) -> Self:
        """A pose from a position [m] and a quaternion (x, y, z, w)."""
        return cls.of(position=position, quaternion_xyzw=xyzw)

    @classmethod
    def from_rpy(cls, position: VectorLike, roll: float, pitch: float, yaw: float) -> Self:
        """A pose from a position [m] and the fixed-axis angles of URDF [rad]."""
        return cls.of(position=position, rpy=[roll, pitch, yaw])

    @classmethod
    def from_zyz(cls, position: VectorLike, phi: float, theta: float, psi: float) -> Self:
        """A pose from a position [m] and Euler angles about z, y, z [rad]."""
        return cls.of(position=position, euler_zyz=[phi, theta, psi])

    @classmethod
    def from_axis_angle(cls, position: VectorLike, axis: VectorLike, angle: float) -> Self:
        """A pose from a position [m], an axis (3,) of any length but 0 and an angle [rad]."""
        return cls.of(position=position, axis_angle=[*as_json(axis), angle])

    @classmethod
    def from_matrix(cls, T_base_pose: RowsLike) -> Self:
        """A pose from a 4x4 transform [[R, p], [0, 1]]."""
        return cls.of(transform=T_base_pose)


class FramedPose(Pose):
    """A pose in the robot's root frame, or in one that it names."""

    frame: Frame | None = None


Orientation = Literal["quaternion_xyzw", "rotation_matrix", "euler_zyz", "rpy", "axis_angle"]


#: Motions that one request composes.
MAX_MOTIONS = 1_000


if TYPE_CHECKING:
    # Where a pose is taken, so is one of an answer, and any where poses may name their frame.
    PoseAnswer: TypeAlias = Pose
    OrientedPoseAnswer: TypeAlias = Pose
    PoseInFrame: TypeAlias = Pose
    AnyPose: TypeAlias = Pose
else:
    PoseInFrame = FramedPose

    class PoseAnswer(Answer):
        """A pose in the robot's root frame."""

        position: list[Coordinate] = Field(examples=[[0.4, 0.0, 0.3]])
        """x, y, z [m]"""
        quaternion_xyzw: list[float] = Field(examples=[[0.0, 0.0, 0.0, 1.0]])
        """orientation as x, y, z, w"""

    class OrientedPoseAnswer(Answer):
        """A pose with its orientation in the form that was asked for."""

        position: list[float] = Field(examples=[[0.4, 0.0, 0.3]])
        """x, y, z [m]"""
        quaternion_xyzw: list[float] | None = Field(None, examples=[[0.0, 0.0, 0.0, 1.0]])
        """orientation as x, y, z, w"""
        rotation_matrix: list[list[float]] | None = None
        """rows"""
        euler_zyz: list[float] | None = None
        """[phi, theta, psi] [rad], theta in [0, pi]; psi = 0 where sin(theta) = 0"""
        rpy: list[float] | None = None
        """[roll, pitch, yaw] [rad], pitch in [-pi/2, pi/2]; roll = 0 at its ends"""
        axis_angle: list[float] | None = None
        """[x, y, z, angle]: a unit axis, the angle [rad] in [0, pi]; z where it is 0"""

    AnyPose = Pose | PoseAnswer | OrientedPoseAnswer


class PoseForm(Pose):
    """A pose in any form; a position that is left out is the origin."""

    published_rules = ({"not": is_given("transform", "position")},)
    may_lack_position: ClassVar[bool] = True


class Motion(PoseForm):
    """A rigid motion of a list that is carried out in turn."""

    about: Literal["current", "fixed"] = "current"
    """current: about the axes of the moved frame, T <- T T_i; fixed: about those of the first one,
    T <- T_i T
    """


class ConvertPoseRequest(BodyWithRules):
    """A pose, or motions to be composed, to be answered in every form."""

    one_of: ClassVar[tuple[str, ...]] = ("pose", "motions")
    at_most_one = (("angular_velocity", "rotation_rate"),)

    model_config = ConfigDict(json_schema_extra={"examples": examples("ConvertPoseRequest")})

    pose: PoseForm | None = None
    motions: Annotated[list[Motion], Field(min_length=1, max_length=MAX_MOTIONS)] | None = None
    """carried out in turn, beginning at the identity"""
    inverse: bool = False
    """invert the pose before it is answered"""
    angular_velocity: Vector3 | None = None
    """ω in the outer frame [rad/s]; S(ω) and the rotation's rate S(ω) R follow"""
    rotation_rate: Matrix3 | None = None
    """dR/dt [1/s] in place of ω, which follows: S(ω) = dR/dt Rᵀ"""


class PoseForms(Answer):
    """A pose in every form."""

    position: list[float]
    """x, y, z [m]"""
    quaternion_xyzw: list[float]
    """with w >= 0; its negative means the same"""
    rotation_matrix: list[list[float]]
    """rows"""
    euler_zyz: list[float]
    """[phi, theta, psi] [rad], theta in [0, pi]"""
    rpy: list[float]
    """[roll, pitch, yaw] [rad], pitch in [-pi/2, pi/2]"""
    axis_angle: list[float]
    """[x, y, z, angle]: a unit axis, angle [rad] in [0, pi]"""
    transform: list[list[float]]
    """rows of [[R, p], [0, 0, 0, 1]]"""
    euler_zyz_branches: list[list[float]]
    """both branches, that of theta in [0, pi] first; one where sin(theta) = 0"""
    rpy_branches: list[list[float]]
    """both branches, that of pitch in [-pi/2, pi/2] first; one where cos(pitch) = 0"""


class SingularFormAnswer(Answer):
    """A form of the orientation that does not determine all of its numbers."""

    form: Literal["euler_zyz", "rpy", "axis_angle"]
    """of the orientation"""
    determined: str = Field(examples=["theta = 0: only phi + psi is determined"])
    """what the rotation determines"""
    choice: str = Field(examples=["psi = 0"])
    """made for the rest"""


class ConvertPoseAnswer(Answer):
    """A pose in every form, its inverse, and where its angles are singular."""

    pose: PoseForms
    inverse: PoseForms
    singular: list[SingularFormAnswer]
    """forms that do not determine all of their numbers"""
    notes: list[str] = Field(default_factory=list)
    """what was done to the request"""
    poses: list[list[list[float]]] | None = None
    """of motions: the 4x4 transform after each"""
    skew: list[list[float]] | None = None
    """S(ω), with S(ω) v = ω × v"""
    angular_velocity: list[float] | None = None
    """ω of that rate [rad/s]"""
    rotation_rate: list[list[float]] | None = None
    """dR/dt = S(ω) R [1/s]"""
