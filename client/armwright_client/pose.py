"""Poses: a position and at most one of five forms of an orientation."""

from collections.abc import Sequence
from typing import ClassVar, Self, TypeAlias

from pydantic import Field, model_validator

from armwright_client.base import (
    Answer,
    Matrix,
    Matrix3,
    Matrix4,
    Request,
    RowsLike,
    Vector3,
    Vector4,
    VectorLike,
    plain,
)

_ORIENTATIONS = ("quaternion_xyzw", "rotation_matrix", "euler_zyz", "rpy", "axis_angle")


class Pose(Request):
    """A position [m] and at most one orientation, the identity if left out; or a transform.

    Answers give `position` and `quaternion_xyzw`, so what was answered can be sent again.

    Args:
        position: [x, y, z] [m]; needed beside all but a transform.
        quaternion_xyzw: Of norm 1 within 1e-3.
        rotation_matrix: 3x3, its rows; within rounding to three digits or more.
        euler_zyz: [phi, theta, psi] with R = Rz(phi) Ry(theta) Rz(psi) [rad].
        rpy: [roll, pitch, yaw] with R = Rz(yaw) Ry(pitch) Rx(roll) [rad].
        axis_angle: [x, y, z, angle]: about an axis of any length but 0, by an angle [rad].
        transform: Rows of [[R, p], [0, 0, 0, 1]], in place of all other forms.
    """

    #: Whether a pose without a position is at the origin.
    may_lack_position: ClassVar[bool] = False

    position: Vector3 = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    quaternion_xyzw: Vector4 | None = None
    rotation_matrix: Matrix3 | None = None
    euler_zyz: Vector3 | None = None
    rpy: Vector3 | None = None
    axis_angle: Vector4 | None = None
    transform: Matrix4 | None = None

    @model_validator(mode="after")
    def _check_form(self) -> Self:
        given = [name for name in _ORIENTATIONS if getattr(self, name) is not None]
        if self.transform is not None:
            if given or any(self.position):
                raise ValueError("transform holds position and orientation; leave all others out")
            rows, values = plain(self.transform), vars(self)
            if rows[3] != [0.0, 0.0, 0.0, 1.0]:
                raise ValueError("the last row of a transform is 0, 0, 0, 1")
            # One form less for all that reads poses.
            values["position"] = [row[3] for row in rows[:3]]
            values["rotation_matrix"] = [row[:3] for row in rows[:3]]
            values["transform"] = None
        elif not self.may_lack_position and "position" not in self.model_fields_set:
            raise ValueError("a pose needs a position or a transform")
        if len(given) > 1:
            raise ValueError(f"give at most one orientation; found {' and '.join(given)}")
        return self

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
        return cls.of(position=position, axis_angle=[*plain(axis), angle])

    @classmethod
    def from_matrix(cls, T_base_pose: RowsLike) -> Self:
        """A pose from a 4x4 transform [[R, p], [0, 1]]."""
        return cls.of(transform=T_base_pose)


class FramedPose(Pose):
    """A pose in a frame.

    Args:
        frame: A link that stands still, or "tool": the tip where the request begins; the root
            frame if left out.
    """

    frame: str | None = None


#: A pose of a goal, an obstacle or a tool motion, perhaps in a frame of its own.
AnyPose: TypeAlias = Pose | FramedPose


class PoseForm(Pose):
    """A pose in any form; a position that is left out is the origin."""

    may_lack_position: ClassVar[bool] = True


class PoseMotion(PoseForm):
    """A rigid motion of a list that is carried out in turn.

    Args:
        about: "current" for the axes of the moved frame, "fixed" for those of the first one.
    """

    about: str = "current"


class ConvertPoseRequest(Request):
    """A pose, or motions to be composed, to be answered in every form."""

    pose: PoseForm | None = None
    motions: Sequence[PoseMotion] | None = None
    inverse: bool = False
    angular_velocity: Vector3 | None = None


class PoseForms(Answer):
    """A pose in every form.

    Args:
        position: [m].
        quaternion_xyzw: With w >= 0.
        rotation_matrix: Rows.
        euler_zyz: [phi, theta, psi] [rad], theta in [0, pi].
        rpy: [roll, pitch, yaw] [rad], pitch in [-pi/2, pi/2].
        axis_angle: [x, y, z, angle], a unit axis, angle [rad] in [0, pi].
        transform: 4x4.
        euler_zyz_branches: Both branches; one where sin(theta) = 0.
        rpy_branches: Both branches; one where cos(pitch) = 0.
    """

    position: list[float]
    quaternion_xyzw: list[float]
    rotation_matrix: Matrix
    euler_zyz: list[float]
    rpy: list[float]
    axis_angle: list[float]
    transform: Matrix
    euler_zyz_branches: Matrix
    rpy_branches: Matrix


class SingularForm(Answer):
    """A form of the orientation that does not determine all of its numbers.

    Args:
        form: "euler_zyz", "rpy" or "axis_angle".
        determined: The combination that is determined.
        choice: The choice made for the rest.
    """

    form: str
    determined: str
    choice: str


class ConvertedPose(Answer):
    """A pose in every form.

    Args:
        pose: The pose.
        inverse: Its inverse.
        singular: Forms that are singular there.
        notes: What was done to the request.
        poses: Of motions: the 4x4 transform after each.
        skew: S(w) of the angular velocity.
        rotation_rate: dR/dt = S(w) R [1/s].
    """

    pose: PoseForms
    inverse: PoseForms
    singular: list[SingularForm]
    notes: list[str] = Field(default_factory=list)
    poses: list[Matrix] | None = None
    skew: Matrix | None = None
    rotation_rate: Matrix | None = None
