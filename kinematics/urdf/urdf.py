"""URDF: the XML description of a robot, read strictly.

Follows the URDF XML specification (wiki.ros.org/urdf/XML). What contradicts it, or can't be
built, is refused with the name of the link or joint; what is merely odd goes into ``lint``.
"""

import math
from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidRobotDescription
from kinematics.readers.lint import URDF, unread_notes
from kinematics.readers.xml_reader import (
    Element,
    attribute,
    children,
    number,
    numbers,
    read_robot,
    single,
)
from kinematics.tree.description import (
    JOINT_TYPES,
    JointDescription,
    LinkDescription,
    Mimic,
    RobotDescription,
)
from kinematics.urdf.links import MAX_LENGTH, read_link, read_origin

#: More links or joints than any robot has.
MAX_LINKS = 1000
#: An axis shorter than this names no direction.
MIN_AXIS = 1e-9

_MISSING = math.nan
_SOFT = ("soft_lower_limit", "soft_upper_limit")
_POSITION_TYPES = ("revolute", "prismatic")
#: Ranges between these are no turns that a joint makes, but may well be degrees [rad].
_DEGREES, _MOST_DEGREES = 44.0, 1500.0
_Named = TypeVar("_Named", LinkDescription, JointDescription)


def parse_urdf(text: str | bytes) -> RobotDescription:
    """Read a URDF text.

    Args:
        text: The XML text; bytes are decoded as its declaration says.

    Returns:
        The tree of links and joints, with warnings in ``lint``.

    Raises:
        InvalidRobotDescription: The text is no URDF or contradicts itself; the message says what,
            at which link or joint, and what to do.
    """
    foreign: list[str] = []
    robot = read_robot(text, "URDF", foreign)
    lint = unread_notes(robot, URDF, foreign)
    name = robot.get("name", "").strip()
    name = attribute(robot, "name", "the robot") if name else "robot"
    links = _index_by_name([read_link(e, lint) for e in _elements(robot, "link")], "link")
    joints = _index_by_name([_joint(e, lint) for e in _elements(robot, "joint")], "joint")
    if not links:
        raise InvalidRobotDescription("the URDF has no <link>")
    root = _root(links, joints)
    _check_mimics(joints)
    return RobotDescription(name, root, links, joints, tuple(lint))


def _elements(robot: Element, tag: str) -> list[Element]:
    found = list(children(robot, tag))
    if len(found) > MAX_LINKS:
        raise InvalidRobotDescription(f"there are {len(found)} {tag}s, at most {MAX_LINKS} may be")
    return found


def _index_by_name(items: list[_Named], kind: str) -> dict[str, _Named]:
    by_name: dict[str, _Named] = {}
    for item in items:
        if item.name in by_name:
            raise InvalidRobotDescription(
                f"two {kind}s are called {item.name!r}", hint="Every name must be used once."
            )
        by_name[item.name] = item
    return by_name


# ------------------------------------------------------------------------------------ joints


def _joint(element: Element, lint: list[str]) -> JointDescription:
    name = attribute(element, "name", "the robot")
    where = f"joint {name!r}"
    type_ = attribute(element, "type", where)
    if type_ not in JOINT_TYPES:
        raise InvalidRobotDescription(
            f"{where} has the unknown type {type_!r}", hint=f"One of: {', '.join(JOINT_TYPES)}."
        )
    lower, upper = _positions(element, type_, where, lint)
    _lint_unobeyed(element, type_, where, lint)
    limit = single(element, "limit", where)
    dynamics = single(element, "dynamics", where)
    moves = type_ in ("revolute", "continuous", "prismatic")
    quantities = ("velocity", "acceleration", "jerk", "effort")
    limits = {q: _limit(limit, q, where, lint if moves else []) for q in quantities}
    return JointDescription(
        name=name,
        type=type_,
        parent=_end(element, "parent", where),
        child=_end(element, "child", where),
        T_parent_joint=read_origin(element, where),
        axis=_axis(element, where, lint) if moves else np.array([1.0, 0.0, 0.0]),
        lower=lower,
        upper=upper,
        damping=_not_negative(dynamics, "damping", where),
        friction=_not_negative(dynamics, "friction", where),
        mimic=_mimic(element, where),
        soft_range=_soft_range(element, where) if moves else None,
        **limits,
    )


def _end(joint: Element, tag: str, where: str) -> str:
    end = single(joint, tag, where)
    if end is None:
        raise InvalidRobotDescription(f"{where} has no <{tag}>")
    return attribute(end, "link", where)


def _axis(joint: Element, where: str, lint: list[str]) -> Array:
    element = single(joint, "axis", where)
    if element is None:
        lint.append(f"{where} has no <axis>: it is x, as the URDF specification says")
        return np.array([1.0, 0.0, 0.0])
    axis = np.array(numbers(element, "xyz", 3, where, bound=MAX_LENGTH))
    length = float(np.linalg.norm(axis))
    if length < MIN_AXIS:
        raise InvalidRobotDescription(
            f"the <axis> of {where} has length {length:g}, so it names no direction",
            hint='Give a unit vector, for example xyz="0 0 1".',
        )
    # Dividing an axis that is already a unit vector would only stir its last digits.
    return axis if length == 1.0 else axis / length


def _positions(joint: Element, type_: str, where: str, lint: list[str]) -> tuple[float, float]:
    limit = single(joint, "limit", where)
    if type_ not in _POSITION_TYPES:
        ends = [] if limit is None else [limit.get("lower"), limit.get("upper")]
        if type_ == "continuous" and any(end is not None for end in ends):
            lint.append(
                f"{where} is continuous: its lower and upper limits are not used, as the URDF "
                "specification says; joint_limits may give it some"
            )
        return -math.inf, math.inf
    if limit is None or (limit.get("lower") is None and limit.get("upper") is None):
        lint.append(
            f"{where} is {type_} and has neither a lower nor an upper limit: unless joint_limits "
            "gives them, its range is unlimited"
        )
        return _MISSING, _MISSING
    lint += [
        f"{where} has no {side!r} limit: it is 0, as the URDF specification says"
        for side in ("lower", "upper")
        if limit.get(side) is None
    ]
    lower = number(limit, "lower", where, default=0.0)
    upper = number(limit, "upper", where, default=0.0)
    if lower > upper:
        # Only a joint of the chain needs its range, and that may be given in joint_limits.
        lint.append(
            f"{where} has the lower limit {lower:g} above its upper limit {upper:g}: its range is "
            "not known"
        )
    if lower == upper:
        lint.append(f"{where} can't move: both its limits are {lower:g}")
    if type_ == "revolute" and _DEGREES < upper - lower <= _MOST_DEGREES:
        lint.append(
            f"{where} turns from {lower:g} to {upper:g} rad, {(upper - lower) / math.tau:.0f} "
            "times around: if these are degrees, URDF has radians"
        )
    return lower, upper


def _lint_unobeyed(joint: Element, type_: str, where: str, lint: list[str]) -> None:
    """Tell what says something of a joint that can't be obeyed."""
    if type_ in ("fixed", "floating", "planar") and single(joint, "mimic", where) is not None:
        lint.append(f"{where} is {type_}: its <mimic> is not obeyed")
    safety = single(joint, "safety_controller", where)
    given = [] if safety is None else [side for side in _SOFT if safety.get(side) is not None]
    if len(given) == 1:
        (missing,) = set(_SOFT) - set(given)
        lint.append(
            f"{where} has a {given[0]} without a {missing}: it is not obeyed (MoveIt takes 0 for "
            "the other)"
        )


def _soft_range(joint: Element, where: str) -> tuple[float, float] | None:
    element = single(joint, "safety_controller", where)
    if element is None or any(element.get(side) is None for side in _SOFT):
        return None
    lower, upper = (number(element, side, where) for side in _SOFT)
    # Both 0 is what exporters write who know no such limits.
    return (lower, upper) if lower < upper else None


def _limit(limit: Element | None, quantity: str, where: str, lint: list[str]) -> float:
    value = _MISSING
    if limit is not None and limit.get(quantity) is not None:
        value = number(limit, quantity, where)
    if value <= 0.0:
        # Exporters write 0 or -1 for "not known"; a joint with speed 0 could not move at all.
        lint.append(f"the {quantity} limit of {where} is {value:g}: taken as not given")
        return _MISSING
    if math.isnan(value) and quantity == "velocity":
        lint.append(f"{where} has no velocity limit")
    return value


def _not_negative(element: Element | None, name: str, where: str) -> float:
    value = 0.0 if element is None else number(element, name, where, default=0.0)
    if value < 0.0:
        raise InvalidRobotDescription(f"the {name} of {where} is negative: {value:g}")
    return value


def _mimic(joint: Element, where: str) -> Mimic | None:
    element = single(joint, "mimic", where)
    if element is None:
        return None
    return Mimic(
        joint=attribute(element, "joint", where),
        multiplier=number(element, "multiplier", where, default=1.0),
        offset=number(element, "offset", where, default=0.0),
    )


# -------------------------------------------------------------------------------- connections


def _root(links: Mapping[str, LinkDescription], joints: Mapping[str, JointDescription]) -> str:
    carrier: dict[str, str] = {}
    for joint in joints.values():
        for end, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                raise InvalidRobotDescription(
                    f"joint {joint.name!r} has the unknown {end} link {link!r}",
                    hint=f"The links are: {_join_names(list(links))}.",
                )
        if joint.child in carrier:
            raise InvalidRobotDescription(
                f"link {joint.child!r} has two parents: it is the child of the joints "
                f"{carrier[joint.child]!r} and {joint.name!r}",
                hint="Closed loops can't be described; cut the loop at one joint.",
            )
        carrier[joint.child] = joint.name
    roots = [name for name in links if name not in carrier]
    if len(roots) > 1:
        raise InvalidRobotDescription(
            f"there are {len(roots)} roots, links that no joint carries: {_join_names(roots)}",
            hint="Join them with joints, or take out those that do not belong to the robot.",
        )
    _check_cycles(links, joints, carrier)
    return roots[0]


def _check_cycles(
    links: Mapping[str, LinkDescription],
    joints: Mapping[str, JointDescription],
    carrier: Mapping[str, str],
) -> None:
    grounded: set[str] = set()
    for name in links:
        walk: dict[str, None] = {}
        link = name
        while link in carrier and link not in grounded:
            if link in walk:
                cycle = [*list(walk)[list(walk).index(link) :], link]
                raise InvalidRobotDescription(
                    f"the links form a cycle: {_join_names(cycle[::-1], ' -> ')}",
                    hint="One link must be the root; every other hangs on one joint.",
                )
            walk[link] = None
            link = joints[carrier[link]].parent
        grounded.update(walk)


def _check_mimics(joints: Mapping[str, JointDescription]) -> None:
    for joint in joints.values():
        seen = [joint.name]
        one = joint
        while one.mimic is not None:
            leader = one.mimic.joint
            if leader not in joints:
                raise InvalidRobotDescription(
                    f"joint {one.name!r} mimics the unknown joint {leader!r}",
                    hint=f"The joints are: {_join_names(list(joints))}.",
                )
            if leader in seen:
                raise InvalidRobotDescription(f"joint {leader!r} mimics itself")
            seen.append(leader)
            one = joints[leader]


def _join_names(names: Sequence[str], separator: str = ", ", most: int = 20) -> str:
    more = f"{separator}... ({len(names)} in all)" if len(names) > most else ""
    return separator.join(names[:most]) + more
