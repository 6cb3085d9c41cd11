"""Poses: a position and at most one of five forms of an orientation."""

from typing import Self

from pydantic import model_validator

from armwright_client.base import Matrix3, Request, RowsLike, Vector3, Vector4, VectorLike, plain

_ORIENTATIONS = ("quaternion_xyzw", "rotation_matrix", "euler_zyz", "rpy", "axis_angle")


class Pose(Request):
    """A position [m] and at most one orientation; no orientation means the identity.

    Answers give `position` and `quaternion_xyzw`, so what was answered can be sent again.

    Args:
        position: [x, y, z] [m].
        quaternion_xyzw: Of norm 1 within 1e-3.
        rotation_matrix: 3x3, its rows.
        euler_zyz: [phi, theta, psi] with R = Rz(phi) Ry(theta) Rz(psi) [rad].
        rpy: [roll, pitch, yaw] with R = Rz(yaw) Ry(pitch) Rx(roll) [rad].
        axis_angle: [x, y, z, angle]: about an axis of any length but 0, by an angle [rad].
    """

    position: Vector3
    quaternion_xyzw: Vector4 | None = None
    rotation_matrix: Matrix3 | None = None
    euler_zyz: Vector3 | None = None
    rpy: Vector3 | None = None
    axis_angle: Vector4 | None = None

    @model_validator(mode="after")
    def _check_orientation(self) -> Self:
        given = [name for name in _ORIENTATIONS if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f"give at most one orientation; found {' and '.join(given)}")
        return self

    @classmethod
    def at(cls, x: float, y: float, z: float) -> Self:
        """The pose at a position [m] with the axes of the base frame."""
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
        """A pose from a 4x4 transform [[R, p], [0, 1]].

        Raises:
            ValueError: It is not 4x4, or its last row is not 0, 0, 0, 1.
        """
        rows = plain(T_base_pose)
        if [len(row) for row in rows] != [4] * 4 or rows[3] != [0.0, 0.0, 0.0, 1.0]:
            raise ValueError("a transform has 4 rows of 4 numbers, the last one 0, 0, 0, 1")
        return cls(
            position=[row[3] for row in rows[:3]], rotation_matrix=[row[:3] for row in rows[:3]]
        )
