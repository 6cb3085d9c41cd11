"""Constraints from wire to domain and back."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from armwright_wire.goals import goal as schema
from kinematics.arrays import Array
from kinematics.errors import InvalidGoal, InvalidPose
from kinematics.model.chain import Chain
from kinematics.pose import from_quaternion
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import (
    BoxRegion,
    ClearanceConstraint,
    ConeConstraint,
    Constraint,
    JointConstraint,
    LineRegion,
    LookAtConstraint,
    OrientationConstraint,
    PlaneRegion,
    PositionConstraint,
    Region,
    RelativePoseConstraint,
    SphereRegion,
    ToolSpeedConstraint,
    TorqueConstraint,
)
from service.translate import poses


def constraint_set(
    bodies: Sequence[schema.Constraint] | None, chain: Chain, *more: Constraint
) -> ConstraintSet | None:
    """The constraints of a request on a robot; None where there are none.

    Args:
        bodies: Bodies of the request.
        chain: The robot.
        more: Put behind them.

    Raises:
        InvalidGoal: One is malformed; the message says which.
        InvalidLinkName: One names a link that there is not.
    """
    made = [_constraint_at(i, body, chain) for i, body in enumerate(bodies or ())]
    return ConstraintSet(chain, (*made, *more)) if made or more else None


def _constraint_at(i: int, body: schema.Constraint, chain: Chain) -> Constraint:
    try:
        made = constraint(body)
        made.rows(chain)
    except (InvalidGoal, InvalidPose) as error:
        details = dict(error.details) | {"constraint": i}
        message = f"constraints[{i}] ({body.type}): {error.message}"
        raise InvalidGoal(message, hint=error.hint, **details) from None
    return made


def constraint(body: schema.Constraint) -> Constraint:
    """The domain's constraint.

    Raises:
        InvalidGoal: It is malformed.
        InvalidPose: A rotation in it is none.
    """
    made: Constraint
    match body:
        case schema.JointConstraint():
            made = JointConstraint(
                body.joint, body.position, body.tolerance_above, body.tolerance_below, body.weight
            )
        case schema.PositionConstraint():
            made = PositionConstraint(
                _region(body.region), body.link, body.point, body.reference_link, body.weight
            )
        case schema.OrientationConstraint():
            made = _orientation(body)
        case schema.LookAtConstraint():
            made = LookAtConstraint(
                body.axis,
                body.target,
                body.angle,
                body.link,
                body.point,
                body.reference_link,
                body.weight,
            )
        case schema.ClearanceConstraint():
            made = ClearanceConstraint(body.margin)
        case schema.RelativePoseConstraint():
            made = RelativePoseConstraint(
                poses.transform(body.pose),
                body.link,
                body.reference_link,
                body.position_tolerance,
                body.orientation_tolerance,
                body.weight,
            )
        case schema.ToolSpeedConstraint():
            made = ToolSpeedConstraint(body.limit)
        case schema.TorqueConstraint():
            made = TorqueConstraint(None if body.limits is None else tuple(body.limits))
    return made


def _orientation(body: schema.OrientationConstraint) -> ConeConstraint | OrientationConstraint:
    if body.quaternion_xyzw is not None and body.axis_tolerances is not None:
        rotation = from_quaternion(body.quaternion_xyzw)
        return OrientationConstraint(
            rotation, body.axis_tolerances, body.link, body.reference_link, body.weight
        )
    assert body.axis is not None
    assert body.direction is not None
    assert body.cone_angle is not None
    return ConeConstraint(
        body.axis, body.direction, body.cone_angle, body.link, body.reference_link, body.weight
    )


def _region(body: schema.Region) -> Region:
    made: Region
    match body:
        case schema.BoxRegion():
            made = BoxRegion(poses.transform(body.pose), np.array(body.size))
        case schema.SphereRegion():
            made = SphereRegion(body.center, body.radius)
        case schema.PlaneRegion():
            made = PlaneRegion(body.point, body.normal, body.tolerance)
        case schema.LineRegion():
            made = LineRegion(body.point, body.direction, body.tolerance, body.length)
    return made


def uses(constraints: ConstraintSet, residuals: Array) -> list[dict[str, Any]]:
    """Residual of each constraint at one configuration, as answers give it.

    Args:
        constraints: m rows.
        residuals: Residuals of the rows, shape (m,).
    """
    answers = []
    for i, made in enumerate(constraints.constraints):
        rows = np.flatnonzero(constraints.owners == i)
        if len(rows):
            worst = int(rows[np.argmax(residuals[rows])])
            answers.append(
                {
                    "constraint": i,
                    "name": made.name,
                    "residual": float(residuals[worst]),
                    "unit": constraints.rows[worst].unit,
                    "hard": made.weight is None,
                }
            )
    return answers
