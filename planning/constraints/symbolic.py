"""The rows of constraints as CasADi expressions: the twin that an optimiser differentiates.

Built on ``kinematics.symbolic`` from the same packed rows as the kernels of ``row``; a test holds
the two equal. Angles and distances have corners where they are 0, so an optimiser is given the
smooth forms: |y|^2 <= u^2, A . d >= cos(u), A . (c - x) >= cos(u) |c - x|.
"""

from typing import NamedTuple

import casadi

from kinematics.symbolic import Expression
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
    if kind is RowKind.JOINT:
        return SmoothRow(q[carrier], lower, upper)
    if kind is RowKind.ROTATION:
        turn = _log(_turn(carrier, reference, data, frames))
        return SmoothRow(casadi.dot(data[6:9], turn), lower, upper)
    if kind is RowKind.ANGLE:
        a = _axis(carrier, reference, data, frames)
        return SmoothRow(casadi.dot(a, data[12:15]), casadi.cos(upper), casadi.inf)
    y = _offset(carrier, reference, data, frames)
    if kind is RowKind.COORDINATE:
        return SmoothRow(casadi.dot(data[12:15], y), lower, upper)
    if kind is RowKind.DISTANCE:
        return SmoothRow(_across(y, data), -casadi.inf, upper * upper)
    a = _axis(carrier, reference, data, frames)
    length = casadi.sqrt(casadi.sumsqr(y) + _TINY)
    return SmoothRow(-casadi.dot(a, y) - casadi.cos(upper) * length, 0.0, casadi.inf)


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
