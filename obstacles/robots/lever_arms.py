"""Lever arms: the farthest that what a joint carries can be from its axis, in any configuration."""

import numpy as np

from kinematics.arrays import Array
from kinematics.model.branch import BodyTree
from kinematics.model.chain import Chain
from obstacles.robots.robot_geometry import RobotGeometry


def lever_arms(robot: RobotGeometry) -> Array:
    """R_k of each joint, shape (n,): [m], 1 for a slide; infinite before a slide without stops.

    A joint that others follow has theirs added, times their multipliers.
    """
    tree = BodyTree.of(robot.chain)
    return _of_joints(robot.chain, tree, pieces_beyond(robot))


def link_arms(chain: Chain, link_name: str) -> Array:
    """The same of a link's origin alone, shape (n,)."""
    tree, link = BodyTree.of(chain), chain.link(link_name)
    beyond = np.zeros(len(tree.parents))
    beyond[link.joint] = float(np.linalg.norm(link.T_joint_link[:3, 3]))
    return _of_joints(chain, tree, beyond)


def _of_joints(chain: Chain, tree: BodyTree, beyond: Array) -> Array:
    """Arms of the joints within their limits, with what is so far from the frames of bodies."""
    largest = tree.positions(np.maximum(np.abs(chain.limits.lower), np.abs(chain.limits.upper)))
    return tree.of_leaders(np.where(tree.slides, 1.0, arms(tree, beyond, largest)))


def pieces_beyond(robot: RobotGeometry) -> Array:
    """Distance of a body's own pieces from its joint at most, shape (bodies,) [m]."""
    beyond = np.zeros(len(BodyTree.of(robot.chain).parents))
    for piece, body in zip(robot.pieces, robot.joints.tolist(), strict=True):
        if body >= 0:
            center, radius = piece.bounding_sphere()
            beyond[body] = max(beyond[body], float(np.linalg.norm(center)) + radius)
    return beyond


def arms(tree: BodyTree, beyond: Array, largest: Array) -> Array:
    """Distance of all that a joint carries from it at most, shape (bodies,) [m].

    Args:
        tree: The bodies.
        beyond: The same of each body's own parts, shape (bodies,) [m].
        largest: Largest absolute positions of the joints, shape (bodies,) [rad or m].
    """
    farthest = beyond.copy()
    lengths = tree.lengths + np.where(tree.slides, largest, 0.0)
    for body in range(len(farthest) - 1, -1, -1):
        parent = tree.parents[body]
        if parent >= 0:
            farthest[parent] = max(farthest[parent], farthest[body] + float(lengths[body]))
    return farthest
