"""Constraints from wire to domain and back."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from armwright_wire.goals import goal as schema
from kinematics.arrays import Array
from kinematics.errors import InvalidGoal, InvalidPose, located
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
from service.fields import shared
from service.translate import poses

#: Kinds of the domain whose fields are those of a request.
_ALIKE: dict[Any, Any] = {
    getattr(schema, kind.__name__): kind
    for kind in (
        *(JointConstraint, LookAtConstraint, ClearanceConstraint, ToolSpeedConstraint),
        *(SphereRegion, PlaneRegion, LineRegion),
    )
}


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
    where = f"constraints[{i}] ({body.type})"
    with located(where, InvalidGoal, InvalidPose, kind=InvalidGoal, details={"constraint": i}):
        made = constraint(body)
        made.rows(chain)
    return made


def constraint(body: schema.Constraint) -> Constraint:
    """The domain's constraint.

    Raises:
        InvalidGoal: It is malformed.
        InvalidPose: A rotation in it is none.
    """
    match body:
        case schema.PositionConstraint():
            given = shared(body, PositionConstraint, without=("region",))
            return PositionConstraint(_region(body.region), **given)
        case schema.OrientationConstraint():
            return _orientation(body)
        case schema.RelativePoseConstraint():
            given = shared(body, RelativePoseConstraint)
            tolerances = body.position_tolerance, body.orientation_tolerance
            given |= zip(("position_tolerances", "orientation_tolerances"), tolerances, strict=True)
            return RelativePoseConstraint(poses.transform(body.pose), **given)
        case schema.TorqueConstraint():
            return TorqueConstraint(None if body.limits is None else tuple(body.limits))
    made: Constraint = _alike(body)
    return made


def _alike(body: Any) -> Any:
    """The domain's value of a part of a request whose fields it calls by the same names."""
    kind = _ALIKE[type(body)]
    return kind(**shared(body, kind))


def _orientation(body: schema.OrientationConstraint) -> ConeConstraint | OrientationConstraint:
    if body.quaternion_xyzw is not None:
        given = shared(body, OrientationConstraint)
        return OrientationConstraint(from_quaternion(body.quaternion_xyzw), **given)
    return ConeConstraint(**shared(body, ConeConstraint))


def _region(body: schema.Region) -> Region:
    if isinstance(body, schema.BoxRegion):
        return BoxRegion(poses.transform(body.pose), np.array(body.size))
    made: Region = _alike(body)
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
