"""Rows: scalar functions of the configuration that constraints bound.

Every geometric constraint is a few rows. A row is a smooth function of the configuration, seen from
a reference frame, with a lower and an upper bound; its residual

    r(q) = max(value(q) - upper, lower - value(q))

is positive by how much the row is violated, in the row's own unit, and negative by what it has to
spare. With x the position of the row's point and A the direction of its axis in the reference:

    JOINT       q_j
    COORDINATE  d . (x - c)
    DISTANCE    |x - c|, without its part along d where d is not 0
    ANGLE       angle(A, d)
    LOOK        angle(A, c - x)
    ROTATION    a . log(K X), with X the rotation of the carrier's frame
"""

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Literal

import numpy as np

from kinematics.arrays import Array, frozen

Unit = Literal["rad", "m"]


class RowKind(IntEnum):
    """Function that a row bounds."""

    JOINT = 0
    COORDINATE = 1
    DISTANCE = 2
    ANGLE = 3
    LOOK = 4
    ROTATION = 5


_ZERO = np.zeros(3)


class Column(IntEnum):
    """Column of a packed row; of vectors and matrices the first."""

    KIND = 0
    CARRIER = 1
    REFERENCE = 2
    #: 3 entries.
    POINT = 3
    #: 3 entries.
    AXIS = 6
    #: 3 entries.
    CENTER = 9
    #: 3 entries.
    DIRECTION = 12
    LOWER = 15
    UPPER = 16
    #: 9 entries, row by row.
    TURN = 17


#: Entries of a packed row.
WIDTH = Column.TURN + 9


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """A scalar with bounds, all of it in the frames of joints.

    Args:
        kind: The function.
        carrier: The joint that carries point and axis, -1 for the base; the joint itself for JOINT.
        reference: The joint whose frame it is seen from, -1 for the base.
        lower: Least value [unit].
        upper: Largest value [unit].
        unit: "rad" or "m".
        point: Point in the carrier's frame, shape (3,) [m].
        axis: Unit vector in the carrier's frame, of ROTATION the component that counts, (3,).
        center: Centre in the reference, shape (3,) [m].
        direction: Unit vector in the reference, or 0, shape (3,).
        turn: K of ROTATION, shape (3, 3).
        label: Description of the bound in words.
    """

    kind: RowKind
    carrier: int
    reference: int
    lower: float
    upper: float
    unit: Unit
    point: Array = field(default_factory=lambda: _ZERO)
    axis: Array = field(default_factory=lambda: _ZERO)
    center: Array = field(default_factory=lambda: _ZERO)
    direction: Array = field(default_factory=lambda: _ZERO)
    turn: Array = field(default_factory=lambda: np.eye(3))
    label: str = ""

    def __post_init__(self) -> None:
        for name in ("point", "axis", "center", "direction", "turn"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def width(self) -> float:
        """Distance of the bounds; of a one-sided row, of the bound from the best value."""
        return self.upper - (0.0 if math.isinf(self.lower) else self.lower)

    def packed(self) -> Array:
        """The row as a kernel reads it, shape (WIDTH,)."""
        return np.array(
            [
                self.kind,
                self.carrier,
                self.reference,
                *self.point,
                *self.axis,
                *self.center,
                *self.direction,
                self.lower,
                self.upper,
                *self.turn.flat,
            ]
        )
