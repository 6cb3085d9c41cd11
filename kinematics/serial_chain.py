"""From a tree to a serial chain: one path of joints moves, everything else is held still."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array
from kinematics.chain import MAX_JOINTS, Chain, JointType, Limits, Link
from kinematics.description import JointDescription, RobotDescription
from kinematics.errors import InvalidRobotDescription
from kinematics.pose import align_z, from_axis_angle, inverse, transform
from kinematics.srdf import Semantics

#: Standard gravity, rounded as robot software does, in a base frame that stands upright.
GRAVITY = (0.0, 0.0, -9.81)

_LIMITS = ("lower", "upper", "velocity", "acceleration", "jerk", "effort")


@dataclass(frozen=True, slots=True)
class Selection:
    """Part of a tree that is the chain.

    Args:
        base_link: Where it starts.
        tip_link: Where it ends.
        joints: Names of its moving joints, base to tip.
        held: Positions of all other moving joints [rad or m], by name.
        lint: What was chosen without being asked for, one sentence each.
    """

    base_link: str
    tip_link: str
    joints: tuple[str, ...]
    held: Mapping[str, float]
    lint: tuple[str, ...]


def serial_chain(
    description: RobotDescription,
    base_link: str | None = None,
    tip_link: str | None = None,
    held: Mapping[str, float] | None = None,
    joint_limits: Mapping[str, Mapping[str, float]] | None = None,
    semantics: Semantics | None = None,
    gravity: ArrayLike = GRAVITY,
) -> Chain:
    """Cut a serial chain out of a tree.

    Every link of the tree becomes a link of the chain: those of side branches are carried by the
    joint they hang on, those above the base stand still.

    Args:
        description: The tree.
        base_link: Where the chain starts; by default where the SRDF's chain does, else the root.
        tip_link: Where it ends; by default where the SRDF's one chain does, else the only leaf.
        held: Positions of joints off the chain [rad or m]; 0, or the limit nearest to 0, for
            those not named. A mimic joint follows the held value of the joint it mimics.
        joint_limits: Values that replace those of the tree: {joint: {quantity: value}}, where a
            quantity is lower, upper, velocity, acceleration, jerk or effort.
        semantics: The SRDF.
        gravity: In the base frame, shape (3,) [m/s^2].

    Raises:
        InvalidRobotDescription: A name is unknown, the tip is open, a joint of the path can't be
            part of a chain, or a value is out of its range.
    """
    chosen = select(description, base_link, tip_link, held, semantics)
    joints = [description.joints[name] for name in chosen.joints]
    offsets, links = _unfold(description, chosen)
    limits, continuous = _limits(joints, joint_limits or {}, description)
    prismatic = [joint.type == "prismatic" for joint in joints]
    return Chain(
        name=description.name,
        joint_names=chosen.joints,
        joint_types=np.where(prismatic, JointType.PRISMATIC, JointType.REVOLUTE),
        offsets=np.array(offsets),
        links=tuple(links),
        base_link=chosen.base_link,
        tip_link=chosen.tip_link,
        limits=limits,
        continuous=np.array(continuous),
        gravity=_gravity(gravity),
        viscous_friction=np.array([joint.damping for joint in joints]),
        coulomb_friction=np.array([joint.friction for joint in joints]),
    )


def _gravity(values: ArrayLike) -> Array:
    try:
        g = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        g = np.zeros(0)
    if g.shape != (3,) or not np.isfinite(g).all():
        raise InvalidRobotDescription("gravity must be three finite numbers [x, y, z]")
    return g


def select(
    description: RobotDescription,
    base_link: str | None = None,
    tip_link: str | None = None,
    held: Mapping[str, float] | None = None,
    semantics: Semantics | None = None,
) -> Selection:
    """Choose base, tip and held positions as ``serial_chain`` does.

    Raises:
        InvalidRobotDescription: As there.
    """
    for role, link in (("base_link", base_link), ("tip_link", tip_link)):
        if link is not None and link not in description.links:
            raise InvalidRobotDescription(
                f"{role} {link!r} is not a link of robot {description.name!r}",
                hint=f"Its links are: {', '.join(description.links)}.",
                link=link,
            )
    base, tip = _ends(description, base_link, tip_link, semantics)
    path = _path(description, base, tip)
    names = tuple(joint.name for joint in path if joint.moves)
    if not names:
        raise InvalidRobotDescription(
            f"no joint moves between {base!r} and {tip!r}",
            hint=f"Other tips are: {', '.join(_leaves(description, description.root))}.",
        )
    if len(names) > MAX_JOINTS:
        raise InvalidRobotDescription(
            f"{len(names)} joints move between {base!r} and {tip!r}, at most {MAX_JOINTS} may"
        )
    positions, lint = _fixed_position(description, names, held or {})
    return Selection(base, tip, names, MappingProxyType(positions), tuple(lint))


# ------------------------------------------------------------------------------ base and tip


def _ends(
    description: RobotDescription,
    base: str | None,
    tip: str | None,
    semantics: Semantics | None,
) -> tuple[str, str]:
    chains = sorted(set(semantics.chains.values())) if semantics else []
    chains = [c for c in chains if base in (None, c[0]) and tip in (None, c[1])]
    if len(chains) == 1 and (base is None or tip is None):
        for link in chains[0]:
            if link not in description.links:
                raise InvalidRobotDescription(f"the SRDF's chain names the unknown link {link!r}")
        return chains[0]
    start = base or description.root
    if tip is not None:
        return start, tip
    leaves = _leaves(description, start)
    if len(leaves) == 1:
        return start, leaves[0]
    candidates = sorted({end for _, end in chains}) or leaves
    raise InvalidRobotDescription(
        f"robot {description.name!r} branches: tip_link must say where the chain ends",
        hint=f"The ends are: {', '.join(candidates)}; any link before them can be named too.",
        candidates=candidates,
    )


def _leaves(description: RobotDescription, start: str) -> list[str]:
    below, waiting = [], [start]
    while waiting:
        link = waiting.pop()
        joints = description.children(link)
        waiting += [joint.child for joint in reversed(joints)]
        if not joints:
            below.append(link)
    return below


def _path(description: RobotDescription, base: str, tip: str) -> list[JointDescription]:
    path: list[JointDescription] = []
    link = tip
    while link != base:
        joint = description.parent_joint(link)
        if joint is None:
            raise InvalidRobotDescription(
                f"tip_link {tip!r} does not hang on base_link {base!r}",
                hint=f"Tips below it are: {', '.join(_leaves(description, base))}.",
            )
        path.append(joint)
        link = joint.parent
    for joint in path:
        _check_in_path(joint, base, tip)
    return path[::-1]


def _check_in_path(joint: JointDescription, base: str, tip: str) -> None:
    where = f"joint {joint.name!r} lies between {base!r} and {tip!r}"
    if joint.type in ("floating", "planar"):
        raise InvalidRobotDescription(
            f"{where} and is {joint.type}: only revolute, continuous, prismatic and fixed joints "
            "can be part of a chain",
            hint=f"Start the chain below it: base_link {joint.child!r}.",
            joint=joint.name,
        )
    if joint.mimic is not None and joint.moves:
        raise InvalidRobotDescription(
            f"{where} and mimics {joint.mimic.joint!r}: each joint of a chain must move on its own",
            hint="Choose a tip_link above it.",
            joint=joint.name,
        )


# ------------------------------------------------------------------------------- held joints


def _fixed_position(
    description: RobotDescription, moving: Sequence[str], asked: Mapping[str, float]
) -> tuple[dict[str, float], list[str]]:
    joints = description.joints
    off_chain = [j for j in joints.values() if j.moves and j.name not in moving]
    free = [joint for joint in off_chain if joint.mimic is None]
    for name in asked:
        if name not in {joint.name for joint in free}:
            raise InvalidRobotDescription(
                f"joint {name!r} can't be held: {_reason_not_lockable(description, moving, name)}",
                hint=f"Joints to hold are: {', '.join(j.name for j in free) or 'none'}.",
                joint=name,
            )
    lint = [
        f"joint {joint.name!r} is {joint.type}: it is held at its origin"
        for joint in joints.values()
        if joint.type in ("floating", "planar")
    ]
    held = {joint.name: _position(joint, asked, lint) for joint in free}
    for joint in off_chain:
        if joint.mimic is not None:
            held[joint.name] = _mimic_position(description, joint, held, moving)
    return held, lint


def _reason_not_lockable(description: RobotDescription, moving: Sequence[str], name: str) -> str:
    if name not in description.joints:
        return "there is no such joint"
    if name in moving:
        return "it is part of the chain"
    if description.joints[name].mimic is not None:
        return "it mimics another joint"
    return f"it is {description.joints[name].type}"


def _position(joint: JointDescription, asked: Mapping[str, float], lint: list[str]) -> float:
    value = asked.get(joint.name)
    if value is None:
        if math.isnan(joint.lower):
            return 0.0
        nearest = min(max(0.0, joint.lower), joint.upper)
        if nearest != 0.0:
            lint.append(f"joint {joint.name!r} is held at {nearest:g}, its limit nearest to 0")
        return nearest
    if not math.isfinite(value) or value < joint.lower or value > joint.upper:
        raise InvalidRobotDescription(
            f"joint {joint.name!r} is to be held at {value:g}, outside its limits "
            f"[{joint.lower:g}, {joint.upper:g}]",
            joint=joint.name,
            value=value,
        )
    return float(value)


def _mimic_position(
    description: RobotDescription,
    joint: JointDescription,
    held: Mapping[str, float],
    moving: Sequence[str],
) -> float:
    multiplier, offset, leader = 1.0, 0.0, joint
    while leader.mimic is not None:
        offset += multiplier * leader.mimic.offset
        multiplier *= leader.mimic.multiplier
        leader = description.joints[leader.mimic.joint]
    if leader.name in moving:
        raise InvalidRobotDescription(
            f"joint {joint.name!r} off the chain mimics {leader.name!r} on it: its links would "
            "move in a way a serial chain can't tell",
            hint="Make it fixed, or choose a tip_link above the joint it mimics.",
            joint=joint.name,
        )
    # What follows a joint that does not move (fixed, floating) stands at the offset.
    return multiplier * held.get(leader.name, 0.0) + offset


# ------------------------------------------------------------------------ frames and limits


def _unfold(description: RobotDescription, chosen: Selection) -> tuple[list[Array], list[Link]]:
    """Offsets of the chain's joints, and every link with the joint that carries it."""
    index = {name: i for i, name in enumerate(chosen.joints)}
    offsets = [np.eye(4)] * len(index)
    links: list[Link] = []
    waiting: list[tuple[str, int, Array]] = [(chosen.base_link, -1, np.eye(4))]
    seen = {chosen.base_link}
    while waiting:
        name, carrier, T = waiting.pop(0)
        links.append(Link(name, carrier, T, description.links[name].inertia))
        for joint in description.children(name):
            if joint.child in seen:
                continue
            seen.add(joint.child)
            if joint.name in index:
                align = transform(align_z(joint.axis))
                offsets[index[joint.name]] = T @ joint.T_parent_joint @ align
                waiting.append((joint.child, index[joint.name], inverse(align)))
            else:
                waiting.append((joint.child, carrier, T @ _held_motion(joint, chosen.held)))
        above = description.parent_joint(name)
        if above is not None and above.parent not in seen:
            seen.add(above.parent)
            T_above = T @ inverse(_held_motion(above, chosen.held))
            waiting.append((above.parent, carrier, T_above))
    return offsets, links


def _held_motion(joint: JointDescription, held: Mapping[str, float]) -> Array:
    """T_parent_child of a joint that is held still."""
    position = held.get(joint.name, 0.0)
    if position == 0.0:
        return joint.T_parent_joint
    if joint.type == "prismatic":
        return joint.T_parent_joint @ transform(position=position * joint.axis)
    return joint.T_parent_joint @ transform(from_axis_angle(joint.axis, position))


def _limits(
    joints: Sequence[JointDescription],
    overrides: Mapping[str, Mapping[str, float]],
    description: RobotDescription,
) -> tuple[Limits, list[bool]]:
    names = [joint.name for joint in joints]
    values = {q: [float(getattr(joint, q)) for joint in joints] for q in _LIMITS}
    for name, limits in overrides.items():
        if name not in names:
            known = "is held, not part of the chain" if name in description.joints else "is unknown"
            raise InvalidRobotDescription(
                f"joint_limits names joint {name!r}, which {known}",
                hint=f"The joints of the chain are: {', '.join(names)}.",
                joint=name,
            )
        for quantity, value in limits.items():
            values_of = _checked_override(name, quantity, value, values)
            values_of[names.index(name)] = float(value)
    for name, lower, upper in zip(names, values["lower"], values["upper"], strict=True):
        if lower > upper:
            raise InvalidRobotDescription(
                f"joint_limits puts the lower limit of joint {name!r} above its upper limit",
                joint=name,
            )
    values["lower"] = [-math.inf if math.isnan(value) else value for value in values["lower"]]
    values["upper"] = [math.inf if math.isnan(value) else value for value in values["upper"]]
    continuous = [
        joint.type in ("continuous", "revolute")
        and math.isinf(values["lower"][i])
        and math.isinf(values["upper"][i])
        for i, joint in enumerate(joints)
    ]
    return Limits(**{q: np.array(v) for q, v in values.items()}), continuous


def _checked_override(
    name: str, quantity: str, value: float, values: dict[str, list[float]]
) -> list[float]:
    if quantity not in values:
        raise InvalidRobotDescription(
            f"joint_limits of joint {name!r} names the unknown quantity {quantity!r}",
            hint=f"One of: {', '.join(_LIMITS)}.",
            joint=name,
        )
    if not math.isfinite(value):
        raise InvalidRobotDescription(f"{quantity} of joint {name!r} must be finite", joint=name)
    if quantity not in ("lower", "upper") and value <= 0.0:
        raise InvalidRobotDescription(
            f"{quantity} of joint {name!r} is {value:g}, it must be positive", joint=name
        )
    return values[quantity]
