"""The tracking error of all joints that a clearance covers."""

import math

import numpy as np

from kinematics.arrays import Array
from kinematics.model.branch import BodyTree
from obstacles.robots.robot_geometry import RobotGeometry


def joint_tolerance(robot: RobotGeometry, clearance: float) -> float | None:
    """A tolerance d: where each joint is off by less than d, nothing moves by the clearance.

    With R_k the farthest that any point carried by joint k can be from its axis in any
    configuration, joints that are off by d move no point by more than d sum_k R_k (R_k = 1 for a
    slide). So d = clearance / sum_k R_k. The joints are put off one by one, the base's first: the
    links beyond each then stand as in the motion itself, within their limits.

    Args:
        robot: The arm with its geometry; what it holds is part of it.
        clearance: Least distance of any pair [m].

    Returns:
        The tolerance [rad or m]; None where nothing can collide or a slide has no stops.
    """
    weights = lever_arms(robot)
    total = float(weights.sum())
    if not math.isfinite(clearance) or clearance <= 0.0 or not math.isfinite(total):
        return None
    return clearance / total if total > 0.0 else None


def lever_arms(robot: RobotGeometry) -> Array:
    """R_k of each joint, shape (n,): [m], 1 for a slide; infinite before a slide without stops.

    A joint that others follow has theirs added, times their multipliers.
    """
    chain = robot.chain
    tree = BodyTree.of(chain)
    largest = tree.positions(np.maximum(np.abs(chain.limits.lower), np.abs(chain.limits.upper)))
    beyond = np.zeros(len(tree.parents))
    for piece, body in zip(robot.pieces, robot.joints.tolist(), strict=True):
        if body >= 0:
            center, radius = piece.bounding_sphere()
            beyond[body] = max(beyond[body], float(np.linalg.norm(center)) + radius)
    for body in range(len(beyond) - 1, -1, -1):
        parent = tree.parents[body]
        if parent >= 0:
            stroke = float(largest[body]) if tree.slides[body] else 0.0
            beyond[parent] = max(beyond[parent], beyond[body] + float(tree.lengths[body]) + stroke)
    return tree.of_leaders(np.where(tree.slides, 1.0, beyond))
