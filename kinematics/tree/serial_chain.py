"""From a tree to a serial chain: one path of joints moves, all others are held at a position."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array
from kinematics.errors import InvalidRobotDescription
from kinematics.model.chain import MAX_JOINTS, Chain, JointType, Link, MimicJoint
from kinematics.pose import align_z, inverse, transform
from kinematics.tree.chain_ends import choose_ends, joints_above, joints_between, leaves
from kinematics.tree.description import JointDescription, RobotDescription
from kinematics.tree.joint_limits import (
    Led,
    joint_limit_values,
    leader_limits,
    mimic_notes,
    mimic_relations,
    narrowed_limits,
    narrowing_note,
)
from kinematics.tree.srdf import Semantics

#: Standard gravity, rounded as robot software does, in a root frame that stands upright.
GRAVITY = (0.0, 0.0, -9.81)
#: Of a chain whose root moves over the ground.
_SEEN_FROM_WORK = (
    "poses and scenes are in the frame of {base!r}, which {joints} moves over the ground: what "
    "stands on the ground is attached to a link there, and forces and torques are not known"
)


@dataclass(frozen=True, slots=True)
class Selection:
    """Part of a tree that is the chain.

    Args:
        base_link: Link that the chain starts at.
        tip_link: Link that the chain ends at.
        joints: Names of its moving joints, base to tip.
        held: Positions of all other joints that could move, without ``mimic_joints``, by name
            [rad or m].
        lint: Remarks on what was chosen without being asked for, one sentence each.
        mimic_joints: Joints off the chain that mimic one of it, by name, each with its leader,
            multiplier and offset.
    """

    base_link: str
    tip_link: str
    joints: tuple[str, ...]
    held: Mapping[str, float]
    lint: tuple[str, ...]
    mimic_joints: Mapping[str, tuple[str, float, float]] = field(default_factory=dict)


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
    joint they hang on, or by one that mimics a joint of the chain; those above the base stand
    still. All poses are in the frame of the tree's root, wherever the chain begins. Where the tip
    does not hang on the base, but both on a link above, the base is the root: work on a positioner,
    with the arm that works on it beside. The positioner's joints are the first of the chain, and
    what stands on the floor moves with them.

    Args:
        description: The tree.
        base_link: Link that the chain starts at; by default that of the SRDF's chain, else the
            root.
        tip_link: Link that the chain ends at; by default that of the SRDF's chain, else the likely
            tip.
        held: Positions of joints off the chain [rad or m]; 0, or the limit nearest to 0, for
            those not named. A mimic joint follows the held value of the joint it mimics.
        joint_limits: Values that replace those of the tree: {joint: {quantity: value}}, where a
            quantity is lower, upper, velocity, acceleration, jerk or effort, and the joint "*"
            stands for all that are not named.
        semantics: The SRDF.
        gravity: Gravity in the root frame, shape (3,) [m/s^2].

    Raises:
        InvalidRobotDescription: A name is unknown, the tip is open, a joint of the path can't be
            part of a chain, or a value is out of its range.
    """
    chosen = select(description, base_link, tip_link, held, semantics)
    above = joints_above(description, chosen.base_link, chosen.tip_link)
    joints = [description.joints[name] for name in chosen.joints]
    offsets, links, mimic_joints = _unfold(description, chosen)
    limits, continuous = joint_limit_values(joints, joint_limits or {}, description.joints)
    limits, continuous = narrowed_limits(
        limits, continuous, chosen.joints, description, chosen.mimic_joints
    )
    if chosen.mimic_joints or any(joint.moves for joint in above):
        limits = replace(limits, effort=np.full(len(joints), np.nan))
    prismatic = [joint.type == "prismatic" for joint in joints]
    aliases = () if semantics is None else semantics.root_aliases(description.root)
    if above:
        aliases = (chosen.base_link,)  # not "world": what stands in the world moves over the work
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
        root_link=chosen.base_link if above else description.root,
        root_aliases=aliases,
        mimic_joints=tuple(mimic_joints),
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
    ends = choose_ends(description, base_link, tip_link, semantics)
    base, tip = ends.base_link, ends.tip_link
    path = joints_between(description, base, tip)
    names = tuple(joint.name for joint in path if joint.moves)
    if not names:
        raise InvalidRobotDescription(
            f"no joint moves between {base!r} and {tip!r}",
            hint=f"Other tips are: {', '.join(leaves(description, description.root))}.",
        )
    if len(names) > MAX_JOINTS:
        raise InvalidRobotDescription(
            f"{len(names)} joints move between {base!r} and {tip!r}, at most {MAX_JOINTS} may"
        )
    positions, lint = held_positions(description, names, held or {})
    mimic_joints = mimic_relations(description, names, base)
    lint += mimic_notes(description, mimic_joints)
    turned = [joint.name for joint in joints_above(description, base, tip) if joint.moves]
    if turned:
        lint.append(_SEEN_FROM_WORK.format(base=base, joints=", ".join(turned)))
    lint = [*ends.lint, *lint]
    return Selection(base, tip, names, MappingProxyType(positions), tuple(lint), mimic_joints)


# ------------------------------------------------------------------------ frames and limits


def _unfold(
    description: RobotDescription, chosen: Selection
) -> tuple[list[Array], list[Link], list[MimicJoint]]:
    """Offsets of the chain's joints, every link with the joint that carries it, and mimic joints.

    The first offset and the links that stand still are in the root frame.
    """
    held, index = chosen.held, {name: i for i, name in enumerate(chosen.joints)}
    offsets = [np.eye(4)] * len(index)
    links: list[Link] = []
    mimic_joints: list[MimicJoint] = []
    reverse = {j.name for j in joints_above(description, chosen.base_link, chosen.tip_link)}
    is_still = not any(description.joints[name].moves for name in reverse)
    # The weight of what mimic joints carry is felt by other joints than those that carry them.
    is_still = is_still and not chosen.mimic_joints
    standing = _poses_to_base(description, chosen) if not reverse else {chosen.base_link: np.eye(4)}
    waiting = [(chosen.base_link, -1, standing[chosen.base_link])]
    seen = {chosen.base_link}
    while waiting:
        name, carrier, T = waiting.pop(0)
        # In a frame that moves over the ground a body's inertia is not the whole of its motion.
        inertia = description.links[name].inertia if is_still else None
        links.append(Link(name, carrier, T, inertia))
        for joint in description.children(name):
            if joint.child in seen:
                continue
            seen.add(joint.child)
            if joint.name in index:
                align = transform(align_z(joint.axis))
                offsets[index[joint.name]] = T @ joint.T_parent_joint @ align
                waiting.append((joint.child, index[joint.name], inverse(align)))
            elif joint.name in chosen.mimic_joints:
                mimic_joints.append(_mimic_joint(joint, carrier, T, chosen))
                body = len(index) + len(mimic_joints) - 1
                waiting.append((joint.child, body, inverse(transform(align_z(joint.axis)))))
            else:
                waiting.append((joint.child, carrier, T @ joint.motion(held.get(joint.name, 0.0))))
        above = description.parent_joint(name)
        if above is not None and above.parent not in seen:
            seen.add(above.parent)
            if above.name in index:
                align = transform(align_z(-above.axis))
                offsets[index[above.name]] = T @ align
                back = inverse(align) @ inverse(above.T_parent_joint)
                waiting.append((above.parent, index[above.name], back))
            elif reverse:
                back = T @ inverse(above.motion(held.get(above.name, 0.0)))
                waiting.append((above.parent, carrier, back))
            else:
                waiting.append((above.parent, carrier, standing[above.parent]))
    return offsets, links, mimic_joints


def _mimic_joint(joint: JointDescription, carrier: int, T: Array, chosen: Selection) -> MimicJoint:
    """A joint that hangs on body ``carrier`` at the link whose frame there is T."""
    leader, multiplier, offset = chosen.mimic_joints[joint.name]
    return MimicJoint(
        name=joint.name,
        joint_type=int(JointType.PRISMATIC if joint.type == "prismatic" else JointType.REVOLUTE),
        parent=carrier,
        leader=chosen.joints.index(leader),
        T_parent_joint=T @ joint.T_parent_joint @ transform(align_z(joint.axis)),
        multiplier=multiplier,
        offset=offset,
    )


def _poses_to_base(description: RobotDescription, chosen: Selection) -> dict[str, Array]:
    """Poses in the root frame of the root, the base link and those between, joints held."""
    poses = {description.root: np.eye(4)}
    for joint in reversed(description.way_to_root(chosen.base_link)):
        poses[joint.child] = poses[joint.parent] @ joint.motion(chosen.held.get(joint.name, 0.0))
    return poses


def held_positions(
    description: RobotDescription, moving: Sequence[str], asked: Mapping[str, float]
) -> tuple[dict[str, float], list[str]]:
    """Positions of the joints off a chain that stand still, and what is odd about them.

    A joint that is not named stands at 0, or at its limit nearest to 0; a mimic joint follows
    the held value of the joint it mimics, whose limits it narrows. One that follows a joint of the
    chain is not held.

    Args:
        description: The tree.
        moving: Names of the joints of the chain.
        asked: Positions that were asked for, by joint [rad or m].

    Raises:
        InvalidRobotDescription: A joint can't be held, or not there.
    """
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
    led: dict[str, list[Led]] = {joint.name: [] for joint in free}
    for name, (leader, m, b) in mimic_relations(description, led, description.root).items():
        led[leader].append((joints[name], m, b))
    held = {joint.name: _position(joint, led[joint.name], asked, lint) for joint in free}
    for joint in off_chain:
        leader, multiplier, offset = description.leader(joint)
        if joint.mimic is not None and (leader not in moving or multiplier == 0.0):
            # What follows a joint that does not move (fixed, floating) stands at the offset.
            held[joint.name] = multiplier * held.get(leader, 0.0) + offset
    return held, lint


def _reason_not_lockable(description: RobotDescription, moving: Sequence[str], name: str) -> str:
    if name not in description.joints:
        return "there is no such joint"
    if name in moving:
        return "it is part of the chain"
    if description.joints[name].mimic is not None:
        return "it mimics another joint"
    return f"it is {description.joints[name].type}"


def _position(
    joint: JointDescription,
    mimic_joints: Sequence[Led],
    asked: Mapping[str, float],
    lint: list[str],
) -> float:
    value = asked.get(joint.name)
    notes = ((mimic[0].name, narrowing_note(joint, mimic)) for mimic in mimic_joints)
    lint += [f"joint {name!r} mimics {joint.name!r}{note}" for name, note in notes if note]
    lower, upper, *_ = leader_limits(joint, mimic_joints)
    if value is None:
        nearest = min(max(0.0, lower), upper)
        if nearest != 0.0:
            lint.append(f"joint {joint.name!r} is held at {nearest:g}, its limit nearest to 0")
        return nearest
    if not math.isfinite(value) or value < lower or value > upper:
        raise InvalidRobotDescription(
            f"joint {joint.name!r} is to be held at {value:g}, outside its limits "
            f"[{lower:g}, {upper:g}]",
            hint="Hold it inside them; joints that mimic it narrow them.",
            joint=joint.name,
            value=value,
        )
    return float(value)
