"""Displacement of the corners of a robot between two configurations, by forward kinematics."""

import numpy as np

from kinematics.arrays import Array
from kinematics.forward import joint_frames
from obstacles.robot_geometry import RobotGeometry


def corner_displacement(robot: RobotGeometry, before: Array, after: Array) -> float:
    """Largest displacement of any corner of any piece between two configurations."""
    here, there = joint_frames(robot.chain, before), joint_frames(robot.chain, after)
    largest = 0.0
    for piece, joint in zip(robot.pieces, robot.joints, strict=True):
        if joint < 0:
            continue
        R, center = piece.T_owner_piece[:3, :3], piece.T_owner_piece[:3, 3]
        ends = np.array([[0.0, 0.0, -piece.half_height], [0.0, 0.0, piece.half_height]])
        p = np.vstack([ends, piece.vertices.reshape(-1, 3)]) @ R.T + center
        moved = (there[joint] - here[joint])[:3, :3] @ p.T
        moved = moved + (there[joint] - here[joint])[:3, 3:]
        largest = max(largest, float(np.linalg.norm(moved, axis=0).max()))
    return largest
