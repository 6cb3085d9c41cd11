"""Positions of the joints off a chain, which are held still."""

import math
from collections.abc import Mapping, Sequence

from kinematics.errors import InvalidRobotDescription
from kinematics.tree.description import JointDescription, RobotDescription
from kinematics.tree.mimic_limits import Led, joint_followers, narrowing_note, room_of


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
    for name, (leader, m, b) in joint_followers(description, led, description.root).items():
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
    followers: Sequence[Led],
    asked: Mapping[str, float],
    lint: list[str],
) -> float:
    value = asked.get(joint.name)
    notes = ((follower[0].name, narrowing_note(joint, follower)) for follower in followers)
    lint += [f"joint {name!r} mimics {joint.name!r}{note}" for name, note in notes if note]
    lower, upper, *_ = room_of(joint, followers)
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
