"""A link held upright within a cone, or near an orientation."""

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen
from kinematics.model.chain import Chain
from kinematics.pose import from_matrix
from planning.constraints.kinds.frames import Attachment, tolerance, tolerances, unit, weight
from planning.constraints.row import Row, RowKind

_AXES = "xyz"


@dataclass(frozen=True, slots=True, eq=False)
class ConeConstraint:
    """An axis of a link stays within a cone: angle(R a, d) <= cone_angle.

    Args:
        axis: Axis of the link, in its frame, of any length, shape (3,).
        direction: Direction of the cone in the reference, of any length, shape (3,).
        cone_angle: Angle between the cone's axis and its surface [rad].
        link: The link; the tip where none is named.
        reference_link: The link whose frame the direction is in; the base where none is named.
        weight: None where it must hold; else what a squared radian of it costs.

    Raises:
        InvalidGoal: Axis or direction is 0, or the angle not in [0, pi].
    """

    axis: ArrayLike
    direction: ArrayLike
    cone_angle: float
    link: str | None = None
    reference_link: str | None = None
    weight: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "axis", unit(self.axis, "axis"))
        object.__setattr__(self, "direction", unit(self.direction, "direction"))
        tolerance(self.cone_angle, "cone_angle", math.pi)
        weight(self.weight)

    @property
    def name(self) -> str:
        """Name of the constraint."""
        return f"orientation cone of {'the tip' if self.link is None else repr(self.link)}"

    def rows(self, chain: Chain) -> list[Row]:
        """Its row on a chain.

        Raises:
            InvalidLinkName: No such link.
            InvalidGoal: The link does not move against the reference.
        """
        at = Attachment.of(chain, self.link, self.reference_link)
        axis, direction = np.asarray(self.axis), np.asarray(self.direction)
        return [angle_row(at, axis, self.cone_angle, "the cone", direction=direction)]


@dataclass(frozen=True, slots=True, eq=False)
class OrientationConstraint:
    """A link's orientation stays near another: |log(R_target^T R)_i| <= axis_tolerances_i.

    Args:
        rotation: The target, in the reference, shape (3, 3).
        axis_tolerances: Tolerances about x, y and z of the target; one of pi or more leaves the
            axis free, shape (3,) or one number [rad].
        link: The link; the tip where none is named.
        reference_link: The link whose frame the target is in; the base where none is named.
        weight: None where it must hold; else what a squared radian of it costs.

    Raises:
        InvalidPose: The target is no rotation.
        InvalidGoal: A tolerance is negative.
    """

    rotation: Array
    axis_tolerances: ArrayLike
    link: str | None = None
    reference_link: str | None = None
    weight: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen(from_matrix(self.rotation)))
        given = tolerances(np.asarray(self.axis_tolerances, dtype=np.float64), "axis_tolerances")
        object.__setattr__(self, "axis_tolerances", given)
        weight(self.weight)

    @property
    def name(self) -> str:
        """Name of the constraint."""
        return f"orientation of {'the tip' if self.link is None else repr(self.link)}"

    def rows(self, chain: Chain) -> list[Row]:
        """A row for each axis that is not free.

        Raises:
            InvalidLinkName: No such link.
            InvalidGoal: The link does not move against the reference.
        """
        at = Attachment.of(chain, self.link, self.reference_link)
        return rotation_rows(at, self.rotation, np.asarray(self.axis_tolerances))


def angle_row(
    at: Attachment,
    axis: Array,
    most: float,
    label: str,
    *,
    direction: Array | None = None,
    sight: tuple[Array, Array] | None = None,
) -> Row:
    """A row that keeps a link's axis within an angle of a direction, or of a line of sight.

    Args:
        at: The link.
        axis: Axis of the link, shape (3,).
        most: The angle [rad].
        label: Description of the bound in words.
        direction: Direction in the link that it is seen from, shape (3,).
        sight: Line of sight in its place: a point of the link and the target in the link it is seen
            from.
    """
    row = partial(
        Row,
        carrier=at.carrier,
        reference=at.reference,
        lower=-np.inf,
        upper=most,
        unit="rad",
        axis=at.axis(axis),
        label=label,
    )
    if sight is not None:
        point, target = sight
        return row(kind=RowKind.LOOK, point=at.point(point), center=at.place(target))
    assert direction is not None
    return row(kind=RowKind.ANGLE, direction=at.direction(direction))


def rotation_rows(at: Attachment, rotation: Array, limits: Array) -> list[Row]:
    """Rows that hold each component of the rotation left to a target within its limit."""
    K, M = at.turn(rotation)
    return [
        Row(
            RowKind.ROTATION,
            at.carrier,
            at.reference,
            -float(limits[i]),
            float(limits[i]),
            "rad",
            axis=M[:, i],
            turn=K,
            label=f"the turn about {_AXES[i]}",
        )
        for i in range(3)
        if limits[i] < math.pi
    ]
