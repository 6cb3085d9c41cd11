"""The link of a tree that is most likely meant as the tip of the arm."""

import re
from dataclasses import dataclass

from kinematics.tree.description import JointDescription, RobotDescription

#: Names of tool frames, the surest first.
_TOOL_NAMES = tuple(
    re.compile(pattern, re.IGNORECASE)
    for pattern in (
        r"tcp|tool_?cent|tool_?point",
        r"(^|_)tool_?0?($|_(link|frame))",
        r"grasp|pinch",
        r"(^|_)(ee|eef|end_?effector|endpoint)($|_|\d)",
        r"flange",
        r"tool",
        r"gripper_(base|link)|(^|_)(hand|palm|gripper)($|_(link|base))",
    )
)
#: Names of what sees, feels or measures: never the tip of an arm.
_SENSOR = re.compile(
    r"camera|optical|kinect|realsense|lens|depth|rgb|sensor|imu|laser|lidar|scan|(^|_)ft_|marker",
    re.IGNORECASE,
)
_FINGER = re.compile(r"finger|knuckle|thumb|jaw|claw|pad($|_)|tip($|_)", re.IGNORECASE)
#: Joints of the smallest arm; a tree that branches behind so many ends in a hand.
_ARM_JOINTS = 4
#: A finger that is named after its gripper.
_GRIPPER = re.compile(r"gripper", re.IGNORECASE)
#: Joints of the longest finger, tendons of hands that are modelled as joints among them.
_FINGER_JOINTS = 7


@dataclass(frozen=True, slots=True)
class TipChoice:
    """The likely tip of a tree.

    Args:
        tip: The link; None where several arms are equally likely.
        candidates: All ends of the tree, the likely ones first.
    """

    tip: str | None
    candidates: tuple[str, ...]


def likely_tip(description: RobotDescription, start: str) -> TipChoice:
    """Choose the tip of the longest movable chain below a link.

    The chain is followed from ``start``. Where it branches, the branch with twice the joints of
    any other goes on. Where an arm branches into fingers, or ends, the links of that body are the
    choice: one named as a tool frame, else the last one that no sensor is.

    Args:
        description: The tree.
        start: Link that the chain starts at.
    """
    depths = _depths(description)
    likely, clear = _follow(description, start, depths)
    ends = leaves(description, start)
    others = [name for name in ends if name not in likely]
    others.sort(key=lambda name: (bool(_SENSOR.search(name)), bool(_FINGER.search(name))))
    return TipChoice(likely[0] if clear else None, (*likely, *others))


def leaves(description: RobotDescription, start: str) -> list[str]:
    """Links below ``start`` that carry none, in the order of the tree."""
    below, waiting = [], [start]
    while waiting:
        link = waiting.pop()
        joints = description.children(link)
        waiting += [joint.child for joint in reversed(joints)]
        if not joints:
            below.append(link)
    return below


def _independent(joint: JointDescription) -> bool:
    return joint.moves and joint.mimic is None


def _depths(description: RobotDescription) -> dict[str, int]:
    """Largest number of independent joints on a way down from each link."""
    order, waiting = [], [description.root]
    while waiting:
        link = waiting.pop()
        order.append(link)
        waiting += [joint.child for joint in description.children(link)]
    depths: dict[str, int] = {}
    for link in reversed(order):
        below = description.children(link)
        depths[link] = max((depths[j.child] + _independent(j) for j in below), default=0)
    return depths


def _follow(
    description: RobotDescription, start: str, depths: dict[str, int]
) -> tuple[list[str], bool]:
    """The likely tips below a link, and whether the first of them is clear."""
    link, joints = start, 0
    while True:
        body, exits = _body(description, link)
        ways = sorted(
            (joint for joint in exits if _independent(joint)),
            key=lambda joint: -depths[joint.child],
        )
        if not ways or _ends_in_hand(joints, exits, ways, depths):
            return [_tip_of_body(description, body)], True
        longest = 1 + depths[ways[0].child]
        others = [1 + depths[joint.child] for joint in exits if joint is not ways[0]]
        if len(exits) > 1 and (longest < _ARM_JOINTS - joints or 2 * max(others) > longest):
            arms = [joint for joint in ways if 2 * (1 + depths[joint.child]) > longest]
            if len(arms) > 1 or longest < _ARM_JOINTS - joints:
                tips = [_follow(description, arm.child, depths)[0] for arm in arms]
                return [tip for likely in tips for tip in likely], False
        link, joints = ways[0].child, joints + 1


def _ends_in_hand(
    joints: int,
    exits: list[JointDescription],
    ways: list[JointDescription],
    depths: dict[str, int],
) -> bool:
    """Whether an arm of so many joints ends where these joints leave its last body."""
    if joints and _are_jaws(exits, ways, depths):
        return True
    if joints < _ARM_JOINTS - 1 or 1 + depths[ways[0].child] > _FINGER_JOINTS:
        return False
    names = [name for joint in exits for name in (joint.name, joint.child)]
    if any(_FINGER.search(name) for name in names):
        return True
    if len(exits) == 1:
        last = depths[ways[0].child] == 0 and joints >= _ARM_JOINTS
        return last and any(_GRIPPER.search(name) for name in names)
    return joints >= _ARM_JOINTS


def _are_jaws(
    exits: list[JointDescription], ways: list[JointDescription], depths: dict[str, int]
) -> bool:
    """Whether two slides leave a body and carry nothing that moves, one as the other does.

    However short the arm is: those are the jaws of a parallel gripper. Turning joints may be the
    last joint of a palletiser and its rod.
    """
    jaw = ways[0]
    return (
        jaw.type == "prismatic"
        and not depths[jaw.child]
        and any(
            joint.type == "prismatic" and joint.mimic is not None and joint.mimic.joint == jaw.name
            for joint in exits
        )
    )


def _body(description: RobotDescription, link: str) -> tuple[list[str], list[JointDescription]]:
    """Links that are fixed to a link, sensors left out, and the joints that leave this body."""
    body, exits, waiting = [], [], [link]
    while waiting:
        name = waiting.pop(0)
        if name == link or not _SENSOR.search(name):
            body.append(name)
        for joint in description.children(name):
            if joint.moves:
                exits.append(joint)
            else:
                waiting.append(joint.child)
    return body, exits


def _tip_of_body(description: RobotDescription, body: list[str]) -> str:
    named = [name for name in body if not _FINGER.search(name)]
    for pattern in _TOOL_NAMES:
        matching = [name for name in named if pattern.search(name)]
        if matching:
            return matching[-1]
    ends = [n for n in body if not any(j.child in body for j in description.children(n))]
    return ends[0] if len(ends) == 1 else body[0]
