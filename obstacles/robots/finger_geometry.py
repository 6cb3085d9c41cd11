"""Robots with their fingers elsewhere, and covers of the fingers on their way."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from kinematics.pose import inverse
from kinematics.tree.fingers import Finger, Fingers, Positions
from obstacles.convex.piece import Piece
from obstacles.robots.robot_geometry import RobotGeometry

#: More than what sums of lengths below ten metres round off [m].
_ROUNDING = 1e-9


def with_fingers(robot: RobotGeometry, positions: Positions) -> RobotGeometry:
    """The robot with its fingers at other positions: their links, masses and solids move.

    Args:
        robot: The robot, perhaps holding something.
        positions: Positions of the joints that lead and move [rad or m]; others stand where they
            are.

    Raises:
        InvalidOption: A joint is no finger's, or its position is outside its limits.
    """
    wanted = robot.fingers.with_positions(positions)
    moved = {name for name in wanted if wanted[name] != robot.fingers.positions[name]}
    if not moved:
        return robot
    return _placed(robot, wanted, {})


def swept_cover(
    robot: RobotGeometry, first: Positions, last: Positions, share: tuple[float, float]
) -> tuple[RobotGeometry, float]:
    """A robot whose fingers hold all that they sweep in a part of their way.

    In the middle of the part each solid of a finger is grown by the farthest that any of its
    points goes in half of the part: |p' - p| <= h sum_j |dq_j| r_j, where r_j is 1 for a sliding
    joint, and the longest distance of the solid from the joint for one that turns.

    Args:
        robot: The robot, perhaps holding something.
        first: Positions of all that lead where the way begins [rad or m].
        last: Positions of all that lead where the way ends [rad or m].
        share: Part of the way, from 0 to 1 of it.

    Returns:
        The robot, and the farthest that a solid was grown [m].
    """
    low, high = share
    middle = 0.5 * (low + high)
    at = {name: first[name] + middle * (last[name] - first[name]) for name in first}
    growths = _growths(robot, (first, last), 0.5 * (high - low))
    return _placed(robot, at, growths), max(growths.values(), default=0.0)


def _placed(
    robot: RobotGeometry, positions: Positions, growths: Mapping[int, float]
) -> RobotGeometry:
    fingers, chain = robot.fingers, robot.chain
    poses = fingers.link_poses(chain, positions)
    turns = {name: T @ inverse(chain.link(name).T_joint_link) for name, T in poses.items()}
    links = tuple(
        replace(link, T_joint_link=poses[link.name]) if link.name in poses else link
        for link in chain.links
    )
    pieces = tuple(
        grown(piece.placed(turns[name]), growths.get(i, 0.0)) if name in turns else piece
        for i, (piece, name) in enumerate(zip(robot.pieces, robot.links, strict=True))
    )
    return replace(
        robot,
        chain=replace(chain, links=links),
        pieces=pieces,
        fingers=Fingers(fingers.joints, positions, fingers.states),
    )


def grown(piece: Piece, radius: float) -> Piece:
    """The convex piece grown by a ball; it covers the triangles that it stands for.

    Args:
        piece: The piece.
        radius: Radius of the ball [m].
    """
    if radius == 0.0:
        return piece
    return replace(piece, offset_radius=piece.offset_radius + radius, surface=None)


def _growths(
    robot: RobotGeometry, ends: tuple[Positions, Positions], half: float
) -> dict[int, float]:
    """By how much each piece of a finger has to be grown, by its number [m]."""
    by_child = {finger.joint.child: finger for finger in robot.fingers.joints}
    growths: dict[int, float] = {}
    for i, (piece, link) in enumerate(zip(robot.pieces, robot.links, strict=True)):
        if link not in by_child:
            continue
        T_link = inverse(robot.chain.link(link).T_joint_link)
        center, radius = piece.placed(T_link).bounding_sphere()
        reach = float(np.linalg.norm(center)) + radius
        way = 0.0
        name = link
        while name in by_child:
            finger = by_child[name]
            turning = finger.leader and finger.joint.type != "prismatic"
            moves = _way(finger, ends)
            way += moves * (reach if turning else 1.0)
            offset = float(np.linalg.norm(finger.joint.T_parent_joint[:3, 3]))
            reach += offset + _slide(finger, ends)
            name = finger.joint.parent
        if way > 0.0:
            growths[i] = half * way + _ROUNDING
    return growths


def _way(finger: Finger, ends: tuple[Positions, Positions]) -> float:
    """How far a joint goes from one end to the other [rad or m]."""
    return abs(finger.position(ends[1]) - finger.position(ends[0])) if finger.leader else 0.0


def _slide(finger: Finger, ends: tuple[Positions, Positions]) -> float:
    """The farthest that a sliding joint is out on its way [m]."""
    if not finger.leader or finger.joint.type != "prismatic":
        return 0.0
    return max(abs(finger.position(end)) for end in ends)


def moved_links(robot: RobotGeometry, leaders: frozenset[str]) -> frozenset[str]:
    """Links that move when some joints of the gripper do.

    Args:
        robot: The robot.
        leaders: The joints that lead.
    """
    moved: set[str] = set()
    for finger in robot.fingers.joints:
        if finger.leader in leaders or finger.joint.parent in moved:
            moved.add(finger.joint.child)
    return frozenset(moved)
