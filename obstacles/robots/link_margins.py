"""Margins of single links: shells about them that what is around must not touch.

A distance d from a link is kept where the link grown by a ball of radius d touches nothing. So the
robot gets the grown solids beside its own, as links that move with it. What checks and proves
knows of no margins of links.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from kinematics.errors import InvalidLinkName, InvalidOption
from kinematics.model.chain import Link
from obstacles.robots.finger_geometry import grown
from obstacles.robots.robot_geometry import Pair, RobotGeometry, sorted_pair
from obstacles.robots.tool import PART, parts_of

#: Last part of the names of shells: of a link's own margin, and of that between own links.
MARGIN, OWN_MARGIN = "margin", "own margin"
_SHELL = "same body"


def with_margins(
    robot: RobotGeometry, links: Mapping[str, float], own: float = 0.0
) -> RobotGeometry:
    """The robot with distances that links keep from obstacles, and from each other.

    Args:
        robot: The robot with its tool, before it holds anything.
        links: Distances by link, a tool's name for all of its parts [m].
        own: Distance of links that may not touch each other [m].

    Raises:
        InvalidLinkName: There is no such link with solids.
        InvalidOption: It is a finger that moves.
    """
    fingers = {finger.joint.child for finger in robot.fingers.joints}
    kept: dict[str, float] = {}
    for name, distance in links.items():
        parts = [part for part in parts_of(name, robot.names) if part in robot.names]
        if not parts:
            raise InvalidLinkName(
                f"margins.links: {name!r} is no link with solids",
                hint=f"There are: {', '.join(robot.names)}.",
                link=name,
            )
        if moving := fingers.intersection(parts):
            raise InvalidOption(
                f"margins.links: {min(moving)!r} is a finger that moves, and has none of its own",
                hint="Name links that carry it, or give the obstacle a margin.",
            )
        kept |= dict.fromkeys(parts, distance)
    arm = _with_shells(robot, kept, MARGIN, set()) if any(kept.values()) else robot
    if not own:
        return arm
    pairs = {(robot.links[i], robot.links[j]) for i, j in robot.self_pairs}
    apart = {(b, a) if a in fingers else (a, b) for a, b in pairs}
    owners = {a for a, _ in apart} - fingers
    return _with_shells(arm, dict.fromkeys(owners, own), OWN_MARGIN, apart)


def _with_shells(
    robot: RobotGeometry, kept: Mapping[str, float], kind: str, apart: set[Pair]
) -> RobotGeometry:
    """A robot with shells about links; of its own links they keep those apart that are paired."""
    chosen = [i for i, link in enumerate(robot.links) if kept.get(link)]
    shells = {robot.links[i]: f"{robot.links[i]}{PART}{kind}" for i in chosen}
    index = robot.chain.index
    added = [
        Link(shell, robot.chain.link(link).joint, robot.chain.link(link).T_joint_link)
        for link, shell in shells.items()
        if link in index
    ]
    every = [*robot.names, *shells.values()]
    allowed = {
        sorted_pair(shell, other): _SHELL
        for link, shell in shells.items()
        for other in every
        if other != shell and (link, other) not in apart
    }
    return replace(
        robot,
        chain=replace(robot.chain, links=(*robot.chain.links, *added)),
        pieces=(*robot.pieces, *(grown(robot.pieces[i], kept[robot.links[i]]) for i in chosen)),
        links=(*robot.links, *(shells[robot.links[i]] for i in chosen)),
        joints=np.concatenate([robot.joints, robot.joints[chosen]]),
        solids=np.concatenate([robot.solids, robot.solids[chosen] + 1_000_000]),
        allowed={**robot.allowed, **allowed},
    )
