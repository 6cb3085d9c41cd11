"""Poses of requests and answers as NumPy and SciPy have them."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from armwright_client import Pose


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


def pose_of(position: NDArray[np.float64], quaternion_wxyz: NDArray[np.float64]) -> Pose:
    """The pose of a position and a quaternion, as requests take it.

    Args:
        position: Shape (3,) [m].
        quaternion_wxyz: Of norm 1, w first, shape (4,).
    """
    w, x, y, z = (float(value) for value in quaternion_wxyz)
    return Pose(position=[float(value) for value in position], quaternion_xyzw=[x, y, z, w])


def roll_pitch_yaw(pose: Pose) -> tuple[float, float, float]:
    """The orientation of a pose as fixed-axis angles of URDF [rad]."""
    roll, pitch, yaw = rotation(pose).as_euler("xyz").tolist()
    return roll, pitch, yaw
