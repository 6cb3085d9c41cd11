"""Joints off a chain that mimic a joint of it: which there are, and the limits they leave it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Limits
from kinematics.description import JointDescription, RobotDescription
from kinematics.errors import InvalidRobotDescription

#: By joint: the joint of the chain that leads, multiplier and offset.
Relations = Mapping[str, tuple[str, float, float]]
#: Quantities without a sign that a follower's limits narrow.
_RATES = ("velocity", "acceleration", "jerk")


def joint_followers(description: RobotDescription, moving: Sequence[str], base: str) -> Relations:
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


def follower_notes(description: RobotDescription, followers: Relations) -> list[str]:
    """Notes on joints that follow, one sentence each."""
    notes = []
    for name, (leader, multiplier, offset) in followers.items():
        shift = f" {'+' if offset > 0.0 else '-'} {abs(offset):g}" if offset else ""
        note = f"joint {name!r} moves with {leader!r}, which it mimics: {multiplier:g} x{shift}"
        own = _allowed(description.joints[name], multiplier, offset)
        led = description.joints[leader]
        known = _least(led.lower, -math.inf), _least(led.upper, math.inf)
        left = None if own is None else (max(known[0], own[0]), min(known[1], own[1]))
        if left is None or (left != known and not left[0] < left[1]):
            note += f"; its own position limits are not used: they leave {leader!r} no room"
        elif left != known:
            note += f"; its limits narrow those of {leader!r} to [{left[0]:.6g}, {left[1]:.6g}]"
        for quantity in _RATES:
            most = float(getattr(description.joints[name], quantity)) / abs(multiplier)
            # Not a number where the follower has no such limit; 0 is taken for none.
            if 0.0 < most < _least(float(getattr(led, quantity)), math.inf):
                note += f"; its {quantity} limit leaves {leader!r} {most:.6g}"
        notes.append(note)
    if followers:
        names = ", ".join(repr(name) for name in followers)
        notes.append(
            f"forces and torques are not known: the weight of what {names} carry is felt by other "
            "joints than those that carry it, which the equations of motion here do not tell"
        )
    return notes


def narrowed_limits(
    limits: Limits,
    continuous: Sequence[bool],
    joints: Sequence[str],
    description: RobotDescription,
    followers: Relations,
) -> tuple[Limits, list[bool]]:
    """The limits of a chain (n joints) within those of the joints that follow it.

    With q = m q_j + b in [l, u] the leader keeps to [(l - b) / m, (u - b) / m], the other way round
    where m < 0, and to 1 / |m| of its rates. Where that leaves no room, the limits are no law.

    Args:
        limits: Of the chain's joints.
        continuous: Which of them turn without end.
        joints: Their names.
        description: The tree.
        followers: From ``joint_followers``.
    """
    lower, upper, endless = limits.lower.copy(), limits.upper.copy(), list(continuous)
    rates: dict[str, Array] = {name: getattr(limits, name).copy() for name in _RATES}
    for name, (leader, multiplier, offset) in followers.items():
        j, joint = joints.index(leader), description.joints[name]
        own = _allowed(joint, multiplier, offset)
        if own is not None:
            low, high = max(float(lower[j]), own[0]), min(float(upper[j]), own[1])
            if low < high:
                lower[j], upper[j] = low, high
                endless[j] = endless[j] and math.isinf(low) and math.isinf(high)
        for quantity in _RATES:
            rate = getattr(joint, quantity) / abs(multiplier)
            if rate > 0.0:
                rates[quantity][j] = np.fmin(rates[quantity][j], rate)
    return replace(limits, lower=lower, upper=upper, **rates), endless


def _allowed(
    joint: JointDescription, multiplier: float, offset: float
) -> tuple[float, float] | None:
    """Where the leader may stand for a follower to keep its limits; None for nowhere."""
    if joint.type == "continuous":
        return -math.inf, math.inf
    low, high = _least(joint.lower, -math.inf), _least(joint.upper, math.inf)
    if not low < high:
        return None
    ends = sorted(((low - offset) / multiplier, (high - offset) / multiplier))
    return ends[0], ends[1]


def _least(value: float, otherwise: float) -> float:
    return otherwise if math.isnan(value) else value
