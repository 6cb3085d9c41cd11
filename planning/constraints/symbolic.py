"""The rows of constraints as CasADi expressions: the twin that an optimiser differentiates.

Built on ``kinematics.symbolic`` from the same packed rows as the kernels of ``row``; a test holds
the two equal. Angles and distances have corners where they are 0, so an optimiser is given the
smooth forms: |y|^2 <= u^2, A . d >= cos(u), A . (c - x) >= cos(u) |c - x|.
"""

from typing import NamedTuple

import casadi

from kinematics.symbolic import Expression, symbolic_frames
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.row import RowKind

#: Keeps the slope of a square root finite at 0, far below any tolerance [m^2].
_TINY = 1e-24


class SmoothRow(NamedTuple):
    """lower <= expression <= upper, equivalent to a residual of at most 0.

    Args:
        expression: Scalar.
        lower: Expression or number.
        upper: Expression or number.
    """

    expression: Expression
    lower: Expression
    upper: Expression


def symbolic_values(constraints: ConstraintSet, q: Expression) -> list[Expression]:
    """Values of the rows, m scalars, in their units.

    Args:
        constraints: Constraints on the robot whose joints q are.
        q: SX or MX, n x 1.

    Raises:
        InvalidRobotState: q has not one entry for each joint.
    """
    frames = symbolic_frames(constraints.chain, q)
    rows = zip(constraints.rows, constraints.packed, strict=True)
    return [
        row_value(row.kind, row.carrier, row.reference, casadi.DM(packed), frames, q)
        for row, packed in rows
    ]


def symbolic_residuals(constraints: ConstraintSet, q: Expression) -> list[Expression]:
    """Residuals of the rows, m scalars: max(value - upper, lower - value).

    Raises:
        InvalidRobotState: q has not one entry for each joint.
    """
    values = symbolic_values(constraints, q)
    return [
        value - row.upper
        if row.lower == -float("inf")
        else casadi.fmax(value - row.upper, row.lower - value)
        for value, row in zip(values, constraints.rows, strict=True)
    ]


def smooth_rows(constraints: ConstraintSet, q: Expression) -> list[SmoothRow]:
    """The rows in forms that are smooth everywhere but at targets and half turns.

    Raises:
        InvalidRobotState: q has not one entry for each joint.
    """
    frames = symbolic_frames(constraints.chain, q)
    rows = zip(constraints.rows, constraints.packed, strict=True)
    return [
        smooth_row(row.kind, row.carrier, row.reference, casadi.DM(packed), frames, q)
        for row, packed in rows
    ]


def row_value(
    kind: RowKind,
    carrier: int,
    reference: int,
    data: Expression,
    frames: list[Expression],
    q: Expression,
) -> Expression:
    """Value of one row whose numbers are ``data`` (WIDTH), constants or parameters."""
    if kind is RowKind.JOINT:
        return q[carrier]
    if kind is RowKind.ROTATION:
        return casadi.dot(data[6:9], _log(_turn(carrier, reference, data, frames)))
    if kind is RowKind.ANGLE:
        return _angle(_axis(carrier, reference, data, frames), data[12:15])
    y = _offset(carrier, reference, data, frames)
    if kind is RowKind.COORDINATE:
        return casadi.dot(data[12:15], y)
    if kind is RowKind.DISTANCE:
        return casadi.sqrt(_across(y, data) + _TINY)
    # The angle does not change with the length of y.
    return _angle(_axis(carrier, reference, data, frames), -y)


def smooth_row(
    kind: RowKind,
    carrier: int,
    reference: int,
    data: Expression,
    frames: list[Expression],
    q: Expression,
) -> SmoothRow:
    """One row in smooth form whose numbers are ``data`` (WIDTH), constants or parameters."""
    lower, upper = data[15], data[16]
    if kind is RowKind.ANGLE:
        a = _axis(carrier, reference, data, frames)
        return SmoothRow(casadi.dot(a, data[12:15]), casadi.cos(upper), casadi.inf)
    if kind in {RowKind.DISTANCE, RowKind.LOOK}:
        y = _offset(carrier, reference, data, frames)
        if kind is RowKind.DISTANCE:
            return SmoothRow(_across(y, data), -casadi.inf, upper * upper)
        a = _axis(carrier, reference, data, frames)
        length = casadi.sqrt(casadi.sumsqr(y) + _TINY)
        return SmoothRow(-casadi.dot(a, y) - casadi.cos(upper) * length, 0.0, casadi.inf)
    value = row_value(kind, carrier, reference, data, frames, q)
    return SmoothRow(value, lower, upper)


def _rotate(joint: int, frames: list[Expression], x: Expression) -> Expression:
    return x if joint < 0 else casadi.mtimes(frames[joint][:3, :3], x)


def _rotate_back(joint: int, frames: list[Expression], x: Expression) -> Expression:
    return x if joint < 0 else casadi.mtimes(frames[joint][:3, :3].T, x)


def _axis(carrier: int, reference: int, data: Expression, frames: list[Expression]) -> Expression:
    return _rotate_back(reference, frames, _rotate(carrier, frames, data[6:9]))


def _offset(carrier: int, reference: int, data: Expression, frames: list[Expression]) -> Expression:
    """The point seen from c, in the reference."""
    x = _rotate(carrier, frames, data[3:6])
    if carrier >= 0:
        x += frames[carrier][:3, 3]
    if reference >= 0:
        x -= frames[reference][:3, 3]
    return _rotate_back(reference, frames, x) - data[9:12]


def _across(y: Expression, data: Expression) -> Expression:
    """|y|^2 without its part along the direction."""
    along = casadi.dot(data[12:15], y)
    return casadi.sumsqr(y - along * data[12:15])


def _angle(a: Expression, d: Expression) -> Expression:
    return casadi.atan2(casadi.sqrt(casadi.sumsqr(casadi.cross(a, d)) + _TINY), casadi.dot(a, d))


def _turn(carrier: int, reference: int, data: Expression, frames: list[Expression]) -> Expression:
    X = _rotate_back(reference, frames, _rotate(carrier, frames, casadi.DM.eye(3)))
    return casadi.mtimes(casadi.reshape(data[17:26], 3, 3).T, X)


def _log(E: Expression) -> Expression:
    """Rotation vector: by the antisymmetric part, which vanishes at half a turn only."""
    s = 0.5 * casadi.vertcat(E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1])
    square = casadi.sumsqr(s)
    sine = casadi.sqrt(square + _TINY)
    cosine = 0.5 * (E[0, 0] + E[1, 1] + E[2, 2] - 1.0)
    # At the identity both are 0: the quotient is then 1.
    return s * casadi.if_else(
        casadi.logic_and(square < 1e-16, cosine > 0.0), 1.0, casadi.atan2(sine, cosine) / sine
    )
