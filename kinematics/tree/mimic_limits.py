"""Joints off a chain that mimic a joint of it: which there are, and the limits they leave it."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from kinematics.errors import InvalidRobotDescription
from kinematics.model.chain import Limits
from kinematics.tree.description import JointDescription, RobotDescription

#: By joint: the joint of the chain that leads, multiplier and offset.
Relations = Mapping[str, tuple[str, float, float]]
#: A joint that follows another, with multiplier and offset.
Led = tuple[JointDescription, float, float]


class LeaderLimits(NamedTuple):
    """Limits of a leading joint within which its mimic joints stay within theirs.

    Args:
        lower: Lowest position [rad or m], -inf for none.
        upper: Highest position [rad or m], inf for none.
        velocity: Largest speed [rad/s or m/s], NaN where not given.
        acceleration: Largest acceleration [rad/s^2 or m/s^2], likewise.
        jerk: Largest jerk [rad/s^3 or m/s^3], likewise.
    """

    lower: float
    upper: float
    velocity: float
    acceleration: float
    jerk: float

    def within(self, joint: JointDescription, multiplier: float, offset: float) -> "LeaderLimits":
        """Rest of a range in which a mimic joint stays inside its limits too.

        With q = m q_j + b in [l, u] the leader keeps to [(l - b) / m, (u - b) / m], the other way
        round where m < 0, and to 1 / |m| of its rates. A range that leaves no room is no law, and
        a rate of 0 is none: so descriptions have them where nobody filled them in.
        """
        if multiplier == 0.0:
            return self
        own = _allowed(joint, multiplier, offset) or (-math.inf, math.inf)
        low, high = max(self.lower, own[0]), min(self.upper, own[1])
        if not low < high:
            low, high = self.lower, self.upper
        rates = []
        for name, rate in zip(self._fields[2:], self[2:], strict=True):
            most = float(getattr(joint, name)) / abs(multiplier)
            rates.append(float(np.fmin(rate, most)) if most > 0.0 else rate)
        return LeaderLimits(low, high, *rates)


def leader_limits(joint: JointDescription, mimic_joints: Iterable[Led] = ()) -> LeaderLimits:
    """Limits of a joint, within those of the joints that follow it.

    A range that contradicts itself is none, and a rate of 0 is not given.

    Args:
        joint: Joint that leads.
        mimic_joints: Mimic joints of the joint.
    """
    low, high = joint.range
    rates = (joint.velocity, joint.acceleration, joint.jerk)
    given = (rate if rate > 0.0 else math.nan for rate in rates)
    limits = LeaderLimits(_least(low, -math.inf), _least(high, math.inf), *given)
    for mimic in mimic_joints:
        limits = limits.within(*mimic)
    return limits


def mimic_relations(description: RobotDescription, moving: Collection[str], base: str) -> Relations:
    """The joints off a chain that mimic one of it, by way of others or not.

    Args:
        description: The tree.
        moving: Names of the joints of the chain.
        base: The link that the chain starts at.

    Raises:
        InvalidRobotDescription: Such a joint carries the chain itself.
    """
    found = {}
    for joint in description.joints.values():
        leader, multiplier, offset = description.leader(joint)
        if joint.mimic is not None and joint.moves and leader in moving and multiplier != 0.0:
            found[joint.name] = leader, multiplier, offset
    link = base
    while (above := description.parent_joint(link)) is not None:
        if above.name in found:
            raise InvalidRobotDescription(
                f"joint {above.name!r} carries the chain and mimics {found[above.name][0]!r} of "
                "it: the chain would not be serial",
                hint=f"Start the chain at base_link {description.root!r}, or make it fixed.",
                joint=above.name,
            )
        link = above.parent
    return MappingProxyType(found)


def mimic_notes(description: RobotDescription, mimic_joints: Relations) -> list[str]:
    """Notes on mimic joints, one sentence each."""
    notes = []
    for name, (leader, multiplier, offset) in mimic_joints.items():
        shift = f" {'+' if offset > 0.0 else '-'} {abs(offset):g}" if offset else ""
        note = f"joint {name!r} moves with {leader!r}, which it mimics: {multiplier:g} x{shift}"
        led = description.joints[name], multiplier, offset
        notes.append(note + narrowing_note(description.joints[leader], led))
    if mimic_joints:
        names = ", ".join(repr(name) for name in mimic_joints)
        notes.append(
            f"forces and torques are not known: the weight of what {names} carry is felt by other "
            "joints than those that carry it, which the equations of motion here do not tell"
        )
    return notes


def narrowing_note(leader: JointDescription, mimic: Led) -> str:
    """Note on how a mimic joint's limits narrow its leader's; empty where they do not.

    Args:
        leader: The joint that leads.
        mimic: Mimic joint of the leader.
    """
    known, own = leader_limits(leader), _allowed(*mimic)
    left, note = known.within(*mimic), ""
    if left[:2] != known[:2]:
        note += f"; its limits narrow those of {leader.name!r} to [{left.lower:.6g}, "
        note += f"{left.upper:.6g}]"
    elif own is None or own[0] > known.lower or own[1] < known.upper:
        note += f"; its own position limits are not used: they leave {leader.name!r} no room"
    for quantity, most, before in zip(left._fields[2:], left[2:], known[2:], strict=True):
        if most < _least(before, math.inf):
            note += f"; its {quantity} limit leaves {leader.name!r} {most:.6g}"
    return note


def narrowed_limits(
    limits: Limits,
    continuous: Sequence[bool],
    joints: Sequence[str],
    description: RobotDescription,
    mimic_joints: Relations,
) -> tuple[Limits, list[bool]]:
    """The limits of a chain (n joints) within those of the joints that follow it.

    Args:
        limits: Limits of the chain's joints.
        continuous: Whether each joint turns without end.
        joints: Names of the joints.
        description: The tree.
        mimic_joints: Mimic joints by ``mimic_relations``.
    """
    rows, endless = {name: np.array(getattr(limits, name)) for name in LeaderLimits._fields}, []
    for name, (leader, multiplier, offset) in mimic_joints.items():
        j = joints.index(leader)
        own = LeaderLimits(*(float(row[j]) for row in rows.values()))
        own = own.within(description.joints[name], multiplier, offset)
        for row, value in zip(rows.values(), own, strict=True):
            row[j] = value
    for j, turns in enumerate(continuous):
        endless.append(turns and math.isinf(rows["lower"][j]) and math.isinf(rows["upper"][j]))
    return replace(limits, **rows), endless


def _allowed(
    joint: JointDescription, multiplier: float, offset: float
) -> tuple[float, float] | None:
    """Range of the leader in which a mimic joint stays inside its limits; None for nowhere."""
    if joint.type == "continuous":
        return -math.inf, math.inf
    low, high = _least(joint.lower, -math.inf), _least(joint.upper, math.inf)
    if not low < high:
        return None
    ends = sorted(((low - offset) / multiplier, (high - offset) / multiplier))
    return ends[0], ends[1]


def _least(value: float, otherwise: float) -> float:
    return otherwise if math.isnan(value) else value
