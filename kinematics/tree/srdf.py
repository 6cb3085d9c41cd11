"""SRDF: what a robot's links and joints mean (groups, named states, pairs that may touch).

Follows the SRDF specification (wiki.ros.org/srdf). Only what a serial chain needs is kept.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from kinematics.arrays import Array, Remade
from kinematics.errors import InvalidRobotDescription, InvalidRobotState
from kinematics.model.chain import Chain
from kinematics.readers.lint import SRDF, unread_notes
from kinematics.readers.xml_reader import Element, attribute, children, number, read_robot
from kinematics.tree.description import RobotDescription

#: What plans move onto a limit without being asked is not worth a note [rad or m].
_TOLERANCE = 1e-6

#: Elements of newer files that say what may touch.
_DEFAULT, _ENABLE = "disable_default_collisions", "enable_collisions"

State = Mapping[str, float]
Pair = tuple[str, str]


@dataclass(frozen=True, slots=True, eq=False)
class Semantics(Remade):
    """Content of an SRDF: groups, states, allowed pairs.

    Args:
        name: The robot's name.
        disabled_collisions: Pairs of links that are not checked, each pair in sorted order.
        chains: (base link, tip link) of each group that is one chain, by the group's name.
        states: Joint values [rad or m] by the group's name (empty where the file
            names none), then the state's.
        virtual_frames: (parent frame, child link) of the virtual joints, by which the robot stands
            in its surroundings.
        own_pairs: Links that the file pairs with themselves, which means nothing.
        default_allowed: Links of <disable_default_collisions>: they may touch every other link that
            no pair is given with.
        enabled_collisions: Pairs of links of <enable_collisions>, each in sorted order; a pair that
            is disabled as well is disabled.
        passive: Joints that the file calls passive.
        notes: Notes on parts of the file that are not obeyed, one sentence each.
        groups: Members of each group: ("link", its name), ("joint", its name), ("group", its name)
            or ("chain", base link, tip link).
    """

    name: str
    disabled_collisions: frozenset[Pair] = frozenset()
    chains: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    states: Mapping[str, Mapping[str, State]] = field(default_factory=dict)
    virtual_frames: tuple[tuple[str, str], ...] = ()
    own_pairs: tuple[str, ...] = ()
    default_allowed: frozenset[str] = frozenset()
    enabled_collisions: frozenset[Pair] = frozenset()
    passive: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    groups: Mapping[str, tuple[tuple[str, ...], ...]] = field(default_factory=dict)

    @property
    def names_allowed_pairs(self) -> bool:
        """Whether the file says which links may touch."""
        return bool(self.disabled_collisions or self.default_allowed)

    def allowed_pairs(self, links: Iterable[str]) -> set[Pair]:
        """Pairs that may touch, each in sorted order.

        As MoveIt decides (``AllowedCollisionMatrix::getAllowedCollision``): what is said of a pair
        counts before what is said of one of its links.

        Args:
            links: All that have solids.
        """
        names = sorted(set(links))
        pairs = {
            (min(a, b), max(a, b)) for a in self.default_allowed for b in names if a != b
        } - self.enabled_collisions
        return pairs | self.disabled_collisions

    def group_links(self, description: RobotDescription) -> dict[str, tuple[str, ...]]:
        """Links of each group, in the order of the robot's description.

        As MoveIt reads them (``RobotModel::addJointModelGroup``): a joint stands for the link that
        it carries, a chain for the links from its tip to its base, without the base.

        Args:
            description: The robot.
        """
        parents = {joint.child: joint.parent for joint in description.joints.values()}

        def above(link: str) -> Iterator[str]:
            while link in description.links:
                yield link
                link = parents.get(link, "")

        def members(group: str, outer: frozenset[str]) -> Iterator[str]:
            for kind, name, *tip in self.groups.get(group, ()) if group not in outer else ():
                if kind == "link":
                    yield name
                elif kind == "joint" and name in description.joints:
                    yield description.joints[name].child
                elif kind == "group":
                    yield from members(name, outer | {group})
                elif kind == "chain" and description.links.keys() >= {name, *tip}:
                    yield from {*above(name)} ^ {*above(*tip)}

        named = {group: {*members(group, frozenset())} for group in self.groups}
        return {
            group: tuple(link for link in description.links if link in links)
            for group, links in named.items()
        }

    def root_aliases(self, root: str) -> tuple[str, ...]:
        """Frames that a virtual joint at its origin puts in the same place as the root link."""
        return tuple(frame for frame, link in self.virtual_frames if link == root != frame)

    def __post_init__(self) -> None:
        for name in ("chains", "groups"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        frozen = {
            group: MappingProxyType({name: MappingProxyType(dict(q)) for name, q in states.items()})
            for group, states in self.states.items()
        }
        object.__setattr__(self, "states", MappingProxyType(frozen))


def parse_srdf(text: str | bytes) -> Semantics:
    """Read an SRDF text.

    Raises:
        InvalidRobotDescription: The text is no SRDF, or an element lacks what it needs.
    """
    foreign: list[str] = []
    robot = read_robot(text, "SRDF", foreign)
    disabled, enabled = (
        [_pair(e) for e in children(robot, tag)] for tag in ("disable_collisions", _ENABLE)
    )
    free = frozenset(attribute(e, "link", "the SRDF") for e in children(robot, _DEFAULT))
    own = tuple(sorted({a for a, b in disabled if a == b}))
    chains: dict[str, tuple[str, str]] = {}
    groups: dict[str, tuple[tuple[str, ...], ...]] = {}
    for group in children(robot, "group"):
        name = attribute(group, "name", "the SRDF")
        where = f"group {name!r}"
        found = [
            (attribute(e, "base_link", where), attribute(e, "tip_link", where))
            for e in children(group, "chain")
        ]
        if name in chains and found:
            raise InvalidRobotDescription(f"two groups of the SRDF are called {name!r}")
        # A group of several chains (both arms) is no serial chain.
        if len(found) == 1:
            chains[name] = found[0]
        named = [
            (tag, e.get("name", "").strip())
            for tag in ("link", "joint", "group")
            for e in children(group, tag)
        ]
        groups[name] = (*groups.get(name, ()), *named, *(("chain", *ends) for ends in found))
    name = robot.get("name", "").strip()
    return Semantics(
        name,
        frozenset((a, b) for a, b in disabled if a != b),
        chains,
        _states(robot),
        _virtual_frames(robot),
        own,
        free,
        frozenset((a, b) for a, b in enabled if a != b),
        tuple(attribute(e, "name", "the SRDF") for e in children(robot, "passive_joint")),
        (*_unobeyed(robot, chains), *unread_notes(robot, SRDF, foreign)),
        groups,
    )


def _unobeyed(robot: Element, chains: Mapping[str, tuple[str, str]]) -> Iterator[str]:
    """Notes on elements that mean something else to MoveIt than they do here."""
    for joint in children(robot, "virtual_joint"):
        type_ = joint.get("type", "").strip()
        if type_ != "fixed":
            yield (
                f"virtual_joint {joint.get('name', '')!r} of the SRDF is {type_ or 'of no type'}: "
                f"the robot's root does not move here, frame {joint.get('parent_frame', '')!r} is "
                "taken to be where it is"
            )
    groups = dict.fromkeys(group.get("name", "").strip() for group in children(robot, "group"))
    others = [name for name in groups if name not in chains]
    if others:
        yield f"groups of the SRDF that are not one chain are not offered: {', '.join(others)}"
    for state in children(robot, "group_state"):
        for joint in children(state, "joint"):
            if len(joint.get("value", "").split()) > 1:
                yield (
                    f"joint {joint.get('name', '')!r} has several values in state "
                    f"{state.get('name', '')!r} of the SRDF: they are not read"
                )


def check_semantics(semantics: Semantics, description: RobotDescription) -> tuple[str, ...]:
    """Hold an SRDF against the URDF it is for.

    Returns:
        Warnings: chains, pairs and states that name what the robot does not have, and pairs of a
        link with itself. Files that serve several variants of a robot have such leftovers. A chain
        of a missing link is not used, and dropping a pair only makes checking stricter.
    """
    lint = [
        f"the chain of group {group!r} in the SRDF names the link {link!r}, which robot "
        f"{description.name!r} does not have: the group is not used"
        for group, ends in semantics.chains.items()
        for link in ends
        if link not in description.links
    ]
    for verb, pairs in (
        ("disables", semantics.disabled_collisions),
        ("enables", semantics.enabled_collisions),
    ):
        off = [pair for pair in pairs if not description.links.keys() >= {*pair}]
        if off:
            names = map(
                repr, sorted({name for pair in off for name in pair} - {*description.links})
            )
            lint.append(
                f"the SRDF {verb} collisions of {len(off)} pair(s) with links that the robot does "
                f"not have: {', '.join(names)}"
            )
    lint += [
        f"the SRDF has {link!r} in <{_DEFAULT}>, but the robot has no such link"
        if link not in description.links
        else f"{link!r} may touch all other links, as <{_DEFAULT}> of the SRDF says, but for those "
        f"of <{_ENABLE}>; what MoveIt does not look at either, obstacles and what is held, it is "
        "kept away from here"
        for link in sorted(semantics.default_allowed)
    ]
    lint += [
        f"the SRDF disables collisions of {link!r} with itself: a link is never checked against "
        "itself"
        for link in semantics.own_pairs
    ]
    lint += [
        f"state {name!r} of group {group!r} in the SRDF names the unknown joint {joint!r}"
        for group, states in semantics.states.items()
        for name, values in states.items()
        for joint in values
        if joint not in description.joints
    ]
    lint += [
        f"joint {name!r} is a passive_joint of the SRDF, which MoveIt does not plan: here it is "
        "planned where the chain has it"
        for name in semantics.passive
        if name in description.joints
        and description.joints[name].moves
        and description.joints[name].mimic is None
    ]
    return (*lint, *semantics.notes)


def _pair(element: Element) -> tuple[str, str]:
    first = attribute(element, "link1", "the SRDF")
    second = attribute(element, "link2", "the SRDF")
    return (first, second) if first < second else (second, first)


def _virtual_frames(robot: Element) -> tuple[tuple[str, str], ...]:
    pairs = [
        (joint.get("parent_frame", "").strip(), joint.get("child_link", "").strip())
        for joint in children(robot, "virtual_joint")
    ]
    return tuple((frame, link) for frame, link in pairs if frame and link)


def _states(robot: Element) -> dict[str, dict[str, dict[str, float]]]:
    states: dict[str, dict[str, dict[str, float]]] = {}
    for element in children(robot, "group_state"):
        name = attribute(element, "name", "the SRDF")
        where = f"group_state {name!r}"
        # Files for pinocchio leave the group out: such states are of the whole robot.
        group = states.setdefault(element.get("group", "").strip(), {})
        if name in group:
            raise InvalidRobotDescription(f"two states of one group are called {name!r}")
        group[name] = {}
        for joint in children(element, "joint"):
            # A value of several numbers is that of a planar or floating joint: none of ours.
            if len(joint.get("value", "").split()) <= 1:
                key = attribute(joint, "name", where)
                group[name][key] = number(joint, "value", f"joint {key!r} of {where}")
    return states


def named_states(chain: Chain, semantics: Semantics) -> tuple[dict[str, Array], list[str]]:
    """States of an SRDF that name every joint of a chain, and a note on those that name a part.

    A state goes by its name; where several groups have one of that name, those after the first
    go by "group/name".

    Args:
        chain: The robot.
        semantics: SRDF of the robot.
    """
    states: dict[str, Array] = {}
    lint = []
    for group, named in semantics.states.items():
        for name, values in named.items():
            missing = [joint for joint in chain.joint_names if joint not in values]
            if len(missing) == chain.n:
                continue
            if missing:
                lint.append(
                    f"state {name!r} of group {group!r} in the SRDF does not name "
                    f"{', '.join(missing)}: it is not offered"
                )
                continue
            key = f"{group}/{name}" if name in states else name
            states[key] = np.array([values[joint] for joint in chain.joint_names])
            lint += _outside(chain, states[key], key)
    return states, lint


def _outside(chain: Chain, q: Array, name: str) -> list[str]:
    """A note on the joints (n,) of a state that are outside their limits."""
    low, high = chain.limits.lower, chain.limits.upper
    beyond = [
        f"{joint} at {value:.6g}, limits {lower:.6g} to {upper:.6g}"
        for joint, value, lower, upper in zip(chain.joint_names, q, low, high, strict=True)
        if not lower - _TOLERANCE <= value <= upper + _TOLERANCE
    ]
    return [f"state {name!r} of the SRDF has {'; '.join(beyond)}"] if beyond else []


def state(states: Mapping[str, Array], name: str, where: str) -> Array:
    """The configuration of a state, shape (n,) [rad or m].

    Args:
        states: States by name.
        name: Name of the state.
        where: The field that names it.

    Raises:
        InvalidRobotState: There is no such state.
    """
    if name not in states:
        raise InvalidRobotState(
            f"{where}: the robot has no state {name!r}",
            hint=f"Its states are: {', '.join(states) or 'none; send an SRDF that has them'}.",
            states=list(states),
        )
    return states[name]
