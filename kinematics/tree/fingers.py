"""Fingers: joints of the branches that hang on the last body of a chain, and where they stand.

The chain holds them still. A gripper opens and closes them while the arm stands: the links behind
them then have other poses in the frame of the joint of the chain that carries them.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from kinematics.arrays import Array, Remade
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain
from kinematics.tree.description import JointDescription, RobotDescription
from kinematics.tree.joint_limits import LeaderLimits, leader_limits
from kinematics.tree.serial_chain import Selection
from kinematics.tree.srdf import Semantics

Positions = Mapping[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class Finger:
    """One joint of a branch: position = multiplier * (position of ``leader``) + offset.

    Args:
        joint: Joint as the file describes it; a fixed one in the middle of a branch among them.
        leader: The joint that it follows, its own name where it follows none; empty where it does
            not move.
        multiplier: Multiplier of the leader's position.
        offset: Added to it [rad or m].
    """

    joint: JointDescription
    leader: str
    multiplier: float = 1.0
    offset: float = 0.0

    def position(self, positions: Positions) -> float:
        """Position of the joint [rad or m], from the positions of those that lead."""
        return self.multiplier * positions.get(self.leader, 0.0) + self.offset

    def motion(self, positions: Positions) -> Array:
        """T_parent_child, shape (4, 4)."""
        return self.joint.motion(self.position(positions))


@dataclass(frozen=True, slots=True, eq=False)
class Fingers(Remade):
    """The joints of all branches that a chain carries, and where they stand.

    Args:
        joints: Joints of the branches, those nearer to the chain first.
        positions: Positions of the joints that lead [rad or m], where the chain holds them.
        states: Named states of those joints, of an SRDF, which name none of the chain's.
    """

    joints: tuple[Finger, ...] = ()
    positions: Positions = field(default_factory=dict)
    states: Mapping[str, Positions] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "positions", MappingProxyType(dict(self.positions)))
        states = {name: MappingProxyType(dict(values)) for name, values in self.states.items()}
        object.__setattr__(self, "states", MappingProxyType(states))

    def moving(self, names: frozenset[str]) -> tuple[Finger, ...]:
        """The joints that move when the leaders ``names`` do."""
        return tuple(finger for finger in self.joints if finger.leader in names)

    def limits(self, leader: str) -> LeaderLimits:
        """Limits of a joint that leads, within those of the joints that follow it."""
        moving = self.moving(frozenset([leader]))
        own = next(finger.joint for finger in moving if finger.joint.name == leader)
        return leader_limits(
            own, ((f.joint, f.multiplier, f.offset) for f in moving if f.joint is not own)
        )

    def with_positions(self, asked: Positions) -> dict[str, float]:
        """Positions of all that lead: those asked for, and where the others stand [rad or m].

        Raises:
            InvalidOption: A joint does not lead, or its position or that of a joint which follows
                it is outside the limits.
        """
        for name, value in asked.items():
            if name not in self.positions:
                raise InvalidOption(
                    f"{name!r} is no joint of a gripper that can be moved",
                    hint=f"There are: {', '.join(self.positions) or 'none'}.",
                    joint=name,
                )
            _check_range(name, value, self.limits(name))
        return {**self.positions, **{name: float(value) for name, value in asked.items()}}

    def link_poses(self, chain: Chain, positions: Positions) -> dict[str, Array]:
        """T_joint_link (4, 4) of every link of the branches, by name.

        Args:
            chain: The robot.
            positions: Positions of all that lead [rad or m].
        """
        poses: dict[str, Array] = {}
        for finger in self.joints:
            parent = finger.joint.parent
            above = poses[parent] if parent in poses else chain.link(parent).T_joint_link
            poses[finger.joint.child] = above @ finger.motion(positions)
        return poses


def _check_range(leader: str, value: float, limits: LeaderLimits) -> None:
    if not (math.isfinite(value) and limits.lower <= value <= limits.upper):
        raise InvalidOption(
            f"joint {leader!r} is to stand at {value:g}, outside its limits "
            f"[{limits.lower:g}, {limits.upper:g}]",
            hint="Name a position inside them; joints that follow it narrow them.",
            joint=leader,
            value=value,
        )


def fingers(
    description: RobotDescription, chosen: Selection, semantics: Semantics | None = None
) -> Fingers:
    """The joints of the branches that hang on the body of a chain's last joint.

    Those that hang on others are no fingers: those of a second arm, a head; nor are those that
    follow a joint of the chain.

    Args:
        description: The tree.
        chosen: The chain in it.
        semantics: The SRDF.
    """
    found: list[Finger] = []
    waiting, behind = [description.joints[chosen.joints[-1]].child], set[str]()
    while waiting:
        link = waiting.pop(0)
        for joint in description.children(link):
            if joint.name in chosen.mimic_joints:
                continue  # What it carries moves with the arm.
            waiting.append(joint.child)
            if joint.moves or link in behind:
                behind.add(joint.child)
                leader = description.leader(joint) if joint.moves else ("",)
                found.append(Finger(joint, *leader))
    leaders = {finger.leader for finger in found if finger.leader}
    positions = {name: value for name, value in chosen.held.items() if name in leaders}
    # What follows a joint that is no finger stays where it is.
    kept = tuple(
        finger if finger.leader in positions or not finger.leader
        else Finger(finger.joint, finger.joint.name, 0.0, chosen.held.get(finger.joint.name, 0.0))
        for finger in found
    )  # fmt: skip
    return Fingers(kept, positions, _states(semantics, positions, chosen))


def _states(
    semantics: Semantics | None, positions: Positions, chosen: Selection
) -> dict[str, dict[str, float]]:
    """States of groups that name joints that lead, and none of the chain's."""
    states: dict[str, dict[str, float]] = {}
    for group, named in ({} if semantics is None else semantics.states).items():
        for name, values in named.items():
            own = {joint: value for joint, value in values.items() if joint in positions}
            if own and not any(joint in chosen.joints for joint in values):
                states[f"{group}/{name}" if name in states else name] = own
    return states
