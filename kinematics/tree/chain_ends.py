"""Base and tip of the chain that is cut out of a tree, given or the likely ones."""

import re
from dataclasses import dataclass

from kinematics.errors import InvalidRobotDescription
from kinematics.tree.description import JointDescription, RobotDescription
from kinematics.tree.srdf import Semantics

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

#: Names of the group that is meant where an SRDF has several.
_ARM_GROUPS = ("arm", "manipulator")
#: So many ends are named in a lint or a hint.
_NAMED_ENDS = 12
#: Joints of several freedoms.
_FREE = ("floating", "planar")


@dataclass(frozen=True, slots=True)
class Ends:
    """First and last link of a chain.

    Args:
        base_link: Link that the chain starts at.
        tip_link: Link that the chain ends at.
        lint: Remarks on what was chosen without being asked for, one sentence each.
    """

    base_link: str
    tip_link: str
    lint: tuple[str, ...] = ()


def choose_ends(
    description: RobotDescription, base: str | None, tip: str | None, semantics: Semantics | None
) -> Ends:
    """Choose the base and the tip of a chain.

    An SRDF's one chain comes first, or its group called arm or manipulator; then the likely tip
    of the tree (``kinematics.tree.chain_ends``).

    Args:
        description: The tree.
        base: The base that was asked for, if any.
        tip: The tip that was asked for, if any.
        semantics: The SRDF, if there is one.

    Raises:
        InvalidRobotDescription: A name is unknown, or several tips are equally likely.
    """
    for role, link in (("base_link", base), ("tip_link", tip)):
        if link is not None and link not in description.links:
            raise InvalidRobotDescription(
                f"{role} {link!r} is not a link of robot {description.name!r}",
                hint=f"Its links are: {', '.join(description.links)}.",
                link=link,
            )
    chains = _srdf_chains(description, base, tip, semantics)
    pairs = sorted(set(chains.values()))
    if pairs and (base is None or tip is None):
        named = [chains[name] for name in _ARM_GROUPS if name in chains]
        if len(pairs) == 1 or named:
            chosen = pairs[0] if len(pairs) == 1 else named[0]
            return Ends(*chosen, lint=_choice_of_group(chains, chosen))
    if tip is not None:
        start = base or _below_free_joints(description, tip)
        return Ends(start, tip)
    return _likely_ends(description, base, sorted({end for _, end in pairs}))


def _likely_ends(description: RobotDescription, base: str | None, named: list[str]) -> Ends:
    start = base or description.root
    if base is not None and not _carries_joint(description, base):
        start = description.root  # work on a positioner: the arm stands beside it
    ends = leaves(description, start)
    choice = likely_tip(description, start)
    candidates = named or list(choice.candidates)
    tip = ends[0] if len(ends) == 1 else None if len(named) > 1 else choice.tip
    if tip is None:
        raise InvalidRobotDescription(
            f"robot {description.name!r} branches: tip_link must say where the chain ends",
            hint=f"The likely ends come first: {', '.join(candidates)}; any link before them can "
            "be named too.",
            candidates=candidates,
        )
    lint = () if len(ends) == 1 else (_choice_of_tip(tip, choice.candidates),)
    return Ends(base or _below_free_joints(description, tip), tip, lint)


def _choice_of_tip(tip: str, candidates: tuple[str, ...]) -> str:
    others = [name for name in candidates if name != tip]
    more = f" and {len(others) - _NAMED_ENDS} more" if len(others) > _NAMED_ENDS else ""
    return (
        f"tip_link is {tip!r}, the likely end of the longest movable chain; the tree also ends at "
        f"{', '.join(others[:_NAMED_ENDS])}{more}"
    )


def _choice_of_group(
    chains: dict[str, tuple[str, str]], chosen: tuple[str, str]
) -> tuple[str, ...]:
    """A note on the group that was taken where the SRDF has several."""
    others = [f"{name} ({tip})" for name, (base, tip) in chains.items() if (base, tip) != chosen]
    if not others:
        return ()
    taken = next(name for name, ends in chains.items() if ends == chosen)
    told = f"tip_link is {chosen[1]!r}, of the SRDF's group {taken!r}; its other groups are "
    return (told + ", ".join(others),)


def _srdf_chains(
    description: RobotDescription,
    base: str | None,
    tip: str | None,
    semantics: Semantics | None,
) -> dict[str, tuple[str, str]]:
    """Chains of the SRDF's groups that the robot has and that suit what was asked for."""
    chains = {} if semantics is None else semantics.chains
    return {
        group: ends
        for group, ends in chains.items()
        if all(link in description.links for link in ends)
        and base in (None, ends[0])
        and tip in (None, ends[1])
    }


def _carries_joint(description: RobotDescription, link: str) -> bool:
    """Whether any joint below a link moves."""
    ways = (_up_and_down(description, link, end)[1] for end in leaves(description, link))
    return any(joint.moves for way in ways for joint in way)


def _below_free_joints(description: RobotDescription, tip: str) -> str:
    """The first link on the way to the tip that no floating or planar joint lies before.

    Raises:
        InvalidRobotDescription: No joint below such a joint moves, or one above it does: a chain
            that began below it would not be the arm.
    """
    way = description.way_to_root(tip)
    free = next((k for k, joint in enumerate(way) if joint.type in _FREE), None)
    if free is None:
        return description.root
    below, above = way[:free], way[free + 1 :]
    if any(joint.moves for joint in above) or not any(joint.moves for joint in below):
        raise _not_of_a_chain(way[free], description.root, tip)
    return way[free].child


def joints_between(description: RobotDescription, base: str, tip: str) -> list[JointDescription]:
    """Joints from the base to the tip, fixed ones among them.

    Where the base is work on a positioner, the way goes up to the link that carries both it and
    the arm, and down from there: see ``joints_above``.

    Raises:
        InvalidRobotDescription: The tip does not hang on the base and no joint moves the base, or
            a joint between them can't be part of a chain.
    """
    up, down = _up_and_down(description, base, tip)
    if up and not (down and any(joint.moves for joint in up)):
        raise InvalidRobotDescription(
            f"tip_link {tip!r} does not hang on base_link {base!r}",
            hint=f"Tips below it are: {', '.join(leaves(description, base))}.",
        )
    path = [*up, *down]
    for joint in path:
        _check_joint(joint, base, tip)
    return path


def joints_above(description: RobotDescription, base: str, tip: str) -> list[JointDescription]:
    """Joints that the way from the base to the tip passes against their direction.

    These are the joints below which the base hangs, but the tip does not: of a positioner that
    carries the work, seen from the work.
    """
    return _up_and_down(description, base, tip)[0]


def _up_and_down(
    description: RobotDescription, base: str, tip: str
) -> tuple[list[JointDescription], list[JointDescription]]:
    """Joints from the base up to the link that base and tip hang on, and from there to the tip."""
    up, down = description.way_to_root(base), description.way_to_root(tip)
    while up and down and up[-1] is down[-1]:
        up.pop()
        down.pop()
    return up, down[::-1]


def _check_joint(joint: JointDescription, base: str, tip: str) -> None:
    if joint.type in _FREE:
        raise _not_of_a_chain(joint, base, tip)
    if joint.mimic is not None and joint.moves:
        raise InvalidRobotDescription(
            f"{_place(joint, base, tip)} and mimics {joint.mimic.joint!r}: each joint of a chain "
            "must move on its own",
            hint="Choose a tip_link above it.",
            joint=joint.name,
        )


def _not_of_a_chain(joint: JointDescription, base: str, tip: str) -> InvalidRobotDescription:
    """The error of a floating or planar joint."""
    return InvalidRobotDescription(
        f"{_place(joint, base, tip)} and is {joint.type}, which is not supported: only revolute, "
        "continuous, prismatic and fixed joints can be part of a chain",
        hint=f"Start the chain below it (base_link {joint.child!r}), end it above it (tip_link "
        f"{joint.parent!r}), or describe its freedoms as revolute and prismatic joints.",
        joint=joint.name,
    )


def _place(joint: JointDescription, base: str, tip: str) -> str:
    return f"joint {joint.name!r} lies between {base!r} and {tip!r}"


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
    return [link for link in _below(description, start) if not description.children(link)]


def _below(description: RobotDescription, start: str) -> list[str]:
    """A link and all that hang on it, each before those that it carries."""
    below, waiting = [], [start]
    while waiting:
        below.append(waiting.pop())
        waiting += [joint.child for joint in reversed(description.children(below[-1]))]
    return below


def _independent(joint: JointDescription) -> bool:
    return joint.moves and joint.mimic is None


def _depths(description: RobotDescription) -> dict[str, int]:
    """Largest number of independent joints on a way down from each link."""
    depths: dict[str, int] = {}
    for link in reversed(_below(description, description.root)):
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
