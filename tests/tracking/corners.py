"""Displacement of the corners of a robot between two configurations, by forward kinematics."""

from functools import lru_cache

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.forward import joint_frames
from obstacles.robots.robot_geometry import RobotGeometry


def corner_displacement(robot: RobotGeometry, before: Array, after: Array) -> float:
    """Largest displacement of any corner of any piece between two configurations."""
    here, there = joint_frames(robot.chain, before), joint_frames(robot.chain, after)
    corners, carriers = _moving_corners(robot)
    moved = (there - here)[carriers] @ corners
    return float(np.linalg.norm(moved[:, :3, 0], axis=1).max(initial=0.0))


@lru_cache(4)
def _moving_corners(robot: RobotGeometry) -> tuple[Array, Indices]:
    """Corners of pieces that move, homogeneous (k, 4, 1), and the joints that carry them (k,)."""
    corners, carriers = [np.zeros((0, 3))], list[int]()
    for piece, joint in zip(robot.pieces, robot.joints, strict=True):
        if joint < 0:
            continue
        R, center = piece.T_owner_piece[:3, :3], piece.T_owner_piece[:3, 3]
        ends = np.array([[0.0, 0.0, -piece.half_height], [0.0, 0.0, piece.half_height]])
        corners.append(np.vstack([ends, piece.vertices.reshape(-1, 3)]) @ R.T + center)
        carriers += [int(joint)] * len(corners[-1])
    places, joints = np.concatenate(corners), np.array(carriers, dtype=np.int64)
    return np.column_stack([places, np.ones(len(places))])[..., None], joints
