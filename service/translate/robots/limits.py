"""Limits of robots from wire to domain, and changes of them."""

import dataclasses
from collections.abc import Collection, Mapping

from armwright_wire.robots import robot as schema
from kinematics.errors import InvalidRobotDescription
from kinematics.model.chain import Chain
from kinematics.tree.joint_limits import (
    ALL_JOINTS,
    apply_rules,
    limits_of_chain,
    moveit_joint_limits,
    moveit_notes,
)


def joint_limits(
    source: dict[str, schema.JointLimits] | str | None,
    joints: Collection[str],
    known: Collection[str],
) -> tuple[dict[str, Mapping[str, float]], list[str]]:
    """Limits of a request for the joints of a chain, and notes on what of it is not used.

    Args:
        source: Limits as requests give them; the text of a joint_limits.yaml is of a whole robot.
        joints: Names of the joints of the chain.
        known: Names of all joints of the robot.

    Raises:
        InvalidRobotDescription: The text can't be read.
    """
    if isinstance(source, str):
        limits, lint = limits_of_chain(moveit_joint_limits(source), joints, known)
        return limits, [*lint, *moveit_notes(source)]
    given = source or {}
    return {name: limits.model_dump(exclude_none=True) for name, limits in given.items()}, []


def with_rules(chain: Chain, rules: schema.DefaultLimits | None) -> tuple[Chain, list[str]]:
    """The chain with the limits that rules make, and a note on each rule.

    Args:
        chain: The robot.
        rules: Rules of a request.

    Raises:
        InvalidRobotDescription: A rule is none.
    """
    if rules is None:
        return chain, []
    limits, notes = apply_rules(
        chain.limits, rules.model_dump(exclude_none=True), chain.joint_names
    )
    return dataclasses.replace(chain, limits=limits), notes


def changed(
    body: schema.RobotBody, changes: schema.RobotChanges, joints: Collection[str]
) -> schema.RobotBody:
    """The document of a robot with other values; what a change does not name stays.

    A change for all joints ("*") replaces what single joints had of the same quantity.

    Args:
        body: The document as it is stored.
        changes: The request.
        joints: Names of the joints of the chain.

    Raises:
        InvalidRobotDescription: A joint is unknown, or the text can't be read.
    """
    merged = {name: dict(values) for name, values in _of_chain(body.joint_limits, joints).items()}
    given = _of_chain(changes.joint_limits, joints)
    for name, values in sorted(given.items(), key=lambda item: item[0] != ALL_JOINTS):
        if name not in (*joints, ALL_JOINTS):
            raise InvalidRobotDescription(
                f"joint_limits names joint {name!r}, which is not part of the chain",
                hint=f"The joints of the chain are: {', '.join(joints)}.",
                joint=name,
            )
        for other in merged if name == ALL_JOINTS else ():
            merged[other] = {q: v for q, v in merged[other].items() if q not in values}
        merged[name] = {**merged.get(name, {}), **values}
    limits = {name: schema.JointLimits(**values) for name, values in merged.items() if values}
    given = {
        name: getattr(body if getattr(changes, name) is None else changes, name)
        for name in ("default_limits", "inertias", "calibration")
    }
    fields = {name: getattr(body, name) for name in body.model_fields_set}
    return schema.RobotBody.model_validate(fields | given | {"joint_limits": limits or None})


def _of_chain(
    source: dict[str, schema.JointLimits] | str | None, joints: Collection[str]
) -> dict[str, Mapping[str, float]]:
    return joint_limits(source, joints, ())[0]
