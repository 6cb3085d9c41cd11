"""Limits of a chain's joints: of its description, of a request, of MoveIt's file, of a rule.

Joints off a chain that mimic a joint of it: which there are, and the limits they leave it.
"""

import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidRobotDescription
from kinematics.model.chain import Limits
from kinematics.readers.lint import meant
from kinematics.readers.yaml_reader import UnreadableYaml, fields_of, finite_number, read_yaml
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
    for above in description.way_to_root(base):
        if above.name in found:
            raise InvalidRobotDescription(
                f"joint {above.name!r} carries the chain and mimics {found[above.name][0]!r} of "
                "it: the chain would not be serial",
                hint=f"Start the chain at base_link {description.root!r}, or make it fixed.",
                joint=above.name,
            )
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


#: The name that stands for all joints of a chain.
ALL_JOINTS = "*"
QUANTITIES = ("lower", "upper", "velocity", "acceleration", "jerk", "effort")
#: Quantities that a rule can give, each with those that it may be a multiple of.
RULED = {"acceleration": ("velocity",), "jerk": ("acceleration", "velocity")}
#: A rule as it is written: "10 x velocity".
_RULE = re.compile(r"\s*(\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)\s*[x*×]\s*([a-z]+)\s*")
#: Limits in MoveIt's joint_limits.yaml: the flag that switches one on, and its value.
_MOVEIT_FIELDS = {
    "velocity": ("has_velocity_limits", "max_velocity"),
    "acceleration": ("has_acceleration_limits", "max_acceleration"),
    "jerk": ("has_jerk_limits", "max_jerk"),
    "effort": ("has_effort_limits", "max_effort"),
    "lower": ("has_position_limits", "min_position"),
    "upper": ("has_position_limits", "max_position"),
}
#: Shares of the limits in MoveIt's joint_limits.yaml that its plans use unless a request says more.
_SCALING = ("default_velocity_scaling_factor", "default_acceleration_scaling_factor")
#: Fields of one joint that ros2_control and Pilz's planner read of such files.
_OTHER_READERS = frozenset(
    ("has_deceleration_limits", "max_deceleration", "has_soft_limits", "soft_lower_limit",
     "soft_upper_limit", "k_position", "k_velocity", "angle_wraparound")
)  # fmt: skip

JointValues = Mapping[str, Mapping[str, float]]


def joint_limit_values(
    joints: Sequence[JointDescription],
    overrides: JointValues,
    known: Collection[str],
) -> tuple[Limits, list[bool]]:
    """Limits of the joints of a chain, and which of them turn without end.

    A position limit that is not known is none.

    Args:
        joints: The moving joints, base to tip, n of them.
        overrides: Values in place of theirs, by joint and quantity; "*" is all joints.
        known: Names of all joints of the tree.

    Raises:
        InvalidRobotDescription: A joint or a quantity is unknown, or a value out of its range.
    """
    names = [joint.name for joint in joints]
    values = {q: [float(getattr(joint, q)) for joint in joints] for q in QUANTITIES}
    for name, limits in sorted(overrides.items(), key=lambda item: item[0] != ALL_JOINTS):
        if name not in (*names, ALL_JOINTS):
            reason = "is held, not part of the chain" if name in known else "is unknown"
            raise InvalidRobotDescription(
                f"joint_limits names joint {name!r}, which {reason}",
                hint=f"The joints of the chain are: {', '.join(names)}.",
                joint=name,
            )
        numbers = range(len(names)) if name == ALL_JOINTS else [names.index(name)]
        for quantity, value in limits.items():
            _check_override(name, quantity, value)
            for i in numbers:
                values[quantity][i] = float(value)
    _check_ranges(joints, values)
    values["lower"] = [-math.inf if math.isnan(value) else value for value in values["lower"]]
    values["upper"] = [math.inf if math.isnan(value) else value for value in values["upper"]]
    continuous = [
        joint.type in ("continuous", "revolute")
        and math.isinf(values["lower"][i])
        and math.isinf(values["upper"][i])
        for i, joint in enumerate(joints)
    ]
    return Limits(**{q: np.array(v) for q, v in values.items()}), continuous


def soft_limit_notes(
    joints: Sequence[JointDescription], limits: Limits, names: Sequence[str]
) -> list[str]:
    """A note where safety controllers hold joints to less than the limits of a chain.

    MoveIt plans within such soft limits, and a controller that has them stops an arm there.

    Args:
        joints: All of the tree.
        limits: Limits of the chain.
        names: Names of the chain's joints.
    """
    soft = {joint.name: joint.soft_range for joint in joints if joint.soft_range is not None}
    told = [
        f"{name} [{soft[name][0]:.6g}, {soft[name][1]:.6g}]"
        for name, lower, upper in zip(names, limits.lower, limits.upper, strict=True)
        if name in soft and (soft[name][0] > lower or soft[name][1] < upper)
    ]
    if not told:
        return []
    note = (
        f"the description has soft limits inside the limits of {', '.join(told)}: plans do not "
        "keep to them, give them in joint_limits (lower, upper) if the controller does"
    )
    return [note]


def _check_ranges(
    joints: Sequence[JointDescription], values: Mapping[str, Sequence[float]]
) -> None:
    for joint, lower, upper in zip(joints, values["lower"], values["upper"], strict=True):
        if not lower > upper:
            continue
        if (lower, upper) == (joint.lower, joint.upper):
            raise InvalidRobotDescription(
                f"joint {joint.name!r} has the lower limit {lower:g} above its upper limit "
                f"{upper:g}",
                hint="Give lower and upper of this joint in joint_limits, or mend the description.",
                joint=joint.name,
            )
        raise InvalidRobotDescription(
            f"joint_limits puts the lower limit of joint {joint.name!r} above its upper limit",
            joint=joint.name,
        )


def _check_override(name: str, quantity: str, value: float) -> None:
    if quantity not in QUANTITIES:
        raise InvalidRobotDescription(
            f"joint_limits of joint {name!r} names the unknown quantity {quantity!r}",
            hint=f"One of: {', '.join(QUANTITIES)}.",
            joint=name,
        )
    if not math.isfinite(value):
        raise InvalidRobotDescription(f"{quantity} of joint {name!r} must be finite", joint=name)
    if quantity not in ("lower", "upper") and value <= 0.0:
        raise InvalidRobotDescription(
            f"{quantity} of joint {name!r} is {value:g}, it must be positive", joint=name
        )


# ------------------------------------------------------------------------ MoveIt's file


def moveit_joint_limits(text: str) -> dict[str, dict[str, float]]:
    """Limits by joint and quantity, of the text of MoveIt's ``joint_limits.yaml``.

    A limit counts unless its flag (``has_velocity_limits``, ...) is false. Scaling factors are no
    limits: `moveit_notes` tells them, and all else that is not obeyed.

    Args:
        text: The YAML text.

    Raises:
        InvalidRobotDescription: The text is no such file; the message names the joint.
    """
    joints = fields_of(_document(text).get("joint_limits"))
    if joints is None:
        raise InvalidRobotDescription(
            "joint_limits: the text has no mapping joint_limits",
            hint="Give the text of a joint_limits.yaml as MoveIt has it, or an object by joint.",
        )
    return {str(name): _moveit_joint(str(name), entry) for name, entry in joints.items()}


def moveit_notes(text: str) -> list[str]:
    """Notes on what of MoveIt's ``joint_limits.yaml`` is not obeyed, or means another thing there.

    Raises:
        InvalidRobotDescription: The text is no YAML.
    """
    root = _document(text)
    notes = []
    factors = {key: finite_number(root.get(key)) for key in _SCALING}
    told = [f"{key} {x:g}" for key, x in factors.items() if x is not None and x != 1.0]
    if told:
        notes.append(
            f"joint_limits: {' and '.join(told)} are of MoveIt's plans alone: here a request "
            "scales its limits by timing.velocity_scaling and timing.acceleration_scaling"
        )
    others = [str(key) for key in root if key not in ("joint_limits", *_SCALING)]
    if others:
        notes.append(f"joint_limits: {', '.join(others)} of the text are not read")
    for name, entry in (fields_of(root.get("joint_limits")) or {}).items():
        notes += _joint_notes(str(name), fields_of(entry) or {})
    return notes


def _joint_notes(name: str, fields: Mapping[str, object]) -> Iterator[str]:
    known = [word for pair in _MOVEIT_FIELDS.values() for word in pair]
    others = sorted(fields.keys() & _OTHER_READERS)
    if others:
        yield f"joint_limits: joint {name!r}: {', '.join(others)}, of other readers, not read"
    for key in sorted(map(str, fields.keys() - {*known, *others})):
        yield f"joint_limits: joint {name!r}: {key} is not read{meant(key, known)}"
    if fields.get("has_velocity_limits") is False:
        yield (
            f"joint_limits: joint {name!r} has no velocity limit in MoveIt (has_velocity_limits is "
            "false): here that of the URDF holds"
        )
    for quantity, (flag, key) in _MOVEIT_FIELDS.items():
        if fields.get(flag) is False and finite_number(fields.get(key)) and quantity != "velocity":
            yield f"joint_limits: joint {name!r}: {key} is not used, {flag} is false"


def _document(text: str) -> Mapping[str, object]:
    try:
        return fields_of(read_yaml(text)) or {}
    except UnreadableYaml as error:
        raise InvalidRobotDescription(f"joint_limits: {error}") from None


def _moveit_joint(name: str, entry: object) -> dict[str, float]:
    fields = fields_of(entry)
    if fields is None:
        raise InvalidRobotDescription(
            f"joint_limits: joint {name!r} needs named fields", joint=name
        )
    limits = {}
    for quantity, (flag, key) in _MOVEIT_FIELDS.items():
        # A limit without its flag counts in MoveIt 1, and one of position always does.
        if fields.get(flag) is False or (flag not in fields and key not in fields):
            continue
        value = finite_number(fields.get(key))
        if value is None and quantity in ("lower", "upper") and key not in fields:
            continue
        if value is None:
            raise InvalidRobotDescription(
                f"joint_limits: joint {name!r} has {flag}, but {key} is no finite number",
                joint=name,
            )
        limits[quantity] = value
    return limits


def limits_of_chain(
    values: JointValues, joints: Collection[str], known: Collection[str]
) -> tuple[dict[str, Mapping[str, float]], list[str]]:
    """The part of a robot's limits that concerns a chain, and a note on the rest.

    Args:
        values: Values by joint and quantity, of the whole robot.
        joints: Names of the joints of the chain.
        known: Names of all joints of the tree.
    """
    kept = {name: limits for name, limits in values.items() if name in (*joints, ALL_JOINTS)}
    off_chain = [name for name in values if name not in kept and name in known]
    unknown = [name for name in values if name not in kept and name not in known]
    lint = []
    if off_chain:
        lint.append(f"joint_limits of {', '.join(off_chain)} are not used: off the chain")
    if unknown:
        lint.append(f"joint_limits names {', '.join(unknown)}, which the robot does not have")
    return kept, lint


# ---------------------------------------------------------------------------------- rules


def apply_rules(
    limits: Limits, rules: Mapping[str, str], joint_names: Sequence[str]
) -> tuple[Limits, list[str]]:
    """Limits with those that are missing made by rules, and a note on each rule.

    Args:
        limits: Limits of n joints.
        rules: Rules by quantity (acceleration, jerk), as a multiple of another: "10 x velocity".
        joint_names: n names.

    Raises:
        InvalidRobotDescription: A rule is none.
    """
    notes = []
    for quantity in RULED:  # acceleration first: jerk may be a multiple of it
        if quantity not in rules:
            continue
        factor, source = parse_rule(quantity, rules[quantity])
        values: Array = getattr(limits, quantity)
        made = factor * getattr(limits, source)
        missing = np.isnan(values) & np.isfinite(made)
        if missing.any():
            names = ", ".join(joint_names[int(i)] for i in np.flatnonzero(missing))
            notes.append(f"{quantity} limits of {names} are ruled: {factor:g} x {source}")
        limits = replace(limits, **{quantity: np.where(missing, made, values)})
    return limits, notes


def parse_rule(quantity: str, rule: str) -> tuple[float, str]:
    """Factor and source of a rule such as "10 x velocity".

    Args:
        quantity: Quantity that the rule makes.
        rule: The text.

    Raises:
        InvalidRobotDescription: The rule is unknown, or its factor is not positive.
    """
    sources = RULED.get(quantity, ())
    match = _RULE.fullmatch(rule)
    factor = 0.0 if match is None else float(match[1])
    if match is None or match[2] not in sources or not 0.0 < factor < math.inf:
        example = f"10 x {sources[0]}" if sources else "none"
        raise InvalidRobotDescription(
            f"default_limits of {quantity}: {rule!r} is no rule",
            hint=f'A rule is a number times one of {", ".join(sources)}: "{example}".',
        )
    return factor, match[2]
