"""Poses of requests and answers as NumPy and SciPy have them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from armwright_client import FramedPose, Pose

#: Positions [m] and directions that are equal but for rounding.
_SAME = 1e-9


def rotation(pose: Pose) -> Rotation:
    """The rotation of a pose in any form."""
    if pose.quaternion_xyzw is not None:
        return Rotation.from_quat(pose.quaternion_xyzw)
    if pose.rotation_matrix is not None:
        return Rotation.from_matrix(np.array(pose.rotation_matrix))
    if pose.euler_zyz is not None:
        return Rotation.from_euler("ZYZ", pose.euler_zyz)
    if pose.rpy is not None:
        return Rotation.from_euler("xyz", pose.rpy)
    if pose.axis_angle is not None:
        axis = np.array(pose.axis_angle[:3])
        return Rotation.from_rotvec(pose.axis_angle[3] * axis / np.linalg.norm(axis))
    return Rotation.identity()


def wxyz(pose: Pose) -> NDArray[np.float64]:
    """The quaternion of a pose, w first, shape (4,)."""
    x, y, z, w = rotation(pose).as_quat()
    return np.array([w, x, y, z])


def pose_of(position: NDArray[np.float64], quaternion_wxyz: NDArray[np.float64]) -> FramedPose:
    """The pose of a position and a quaternion, as requests take it.

    Args:
        position: Shape (3,) [m].
        quaternion_wxyz: Unit quaternion, w first, shape (4,).
    """
    w, x, y, z = (float(value) for value in quaternion_wxyz)
    return FramedPose(position=[float(value) for value in position], quaternion_xyzw=[x, y, z, w])


def roll_pitch_yaw(pose: Pose) -> tuple[float, float, float]:
    """The orientation of a pose as fixed-axis angles of URDF [rad]."""
    roll, pitch, yaw = rotation(pose).as_euler("xyz", suppress_warnings=True).tolist()
    return roll, pitch, yaw


def stays_in(poses: Sequence[Pose], others: Sequence[Pose]) -> bool:
    """Whether a body keeps its pose in the frame of another one.

    Args:
        poses: Poses of the body, in the root frame.
        others: Poses of the other body at the same configurations.
    """
    seen = [_seen_from(other, pose) for pose, other in zip(poses, others, strict=True)]
    return all(np.allclose(item, seen[0], rtol=0.0, atol=_SAME) for item in seen)


def _seen_from(frame: Pose, pose: Pose) -> NDArray[np.float64]:
    """Position and rotation matrix of a pose in a frame, shape (12,)."""
    back = rotation(frame).inv()
    position = back.apply(np.array(pose.position, dtype=float) - np.array(frame.position))
    return np.concatenate([position, (back * rotation(pose)).as_matrix().ravel()])
