"""A link's axis pointing at a target."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kinematics.model.chain import Chain
from planning.constraints.kinds.frames import Attachment, tolerance, unit, vector, weight
from planning.constraints.kinds.orientation import angle_row
from planning.constraints.row import Row


@dataclass(frozen=True, slots=True, eq=False)
class LookAtConstraint:
    """The ray from a point of a link along an axis passes a target: angle(R a, c - x) <= angle.

    Args:
        axis: Axis of the link, in its frame, of any length, shape (3,).
        target: Target in the reference, shape (3,) [m].
        angle: [rad].
        link: The link; the tip where none is named.
        point: The ray's origin in the link's frame, shape (3,) [m].
        reference_link: The link whose frame the target is in; the base where none is named.
        weight: None where it must hold; else what a squared radian of it costs.

    Raises:
        InvalidGoal: The axis is 0, the target not finite, or the angle not in [0, pi].
    """

    axis: ArrayLike
    target: ArrayLike
    angle: float
    link: str | None = None
    point: ArrayLike = (0.0, 0.0, 0.0)
    reference_link: str | None = None
    weight: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "axis", unit(self.axis, "axis"))
        object.__setattr__(self, "target", vector(self.target, "target"))
        object.__setattr__(self, "point", vector(self.point, "point"))
        tolerance(self.angle, "angle", math.pi)
        weight(self.weight)

    @property
    def name(self) -> str:
        """Name of the constraint."""
        return f"look-at of {'the tip' if self.link is None else repr(self.link)}"

    def rows(self, chain: Chain) -> list[Row]:
        """Its row on a chain.

        Raises:
            InvalidLinkName: No such link.
            InvalidGoal: The link does not move against the reference.
        """
        at = Attachment.of(chain, self.link, self.reference_link)
        sight = np.asarray(self.point), np.asarray(self.target)
        return [angle_row(at, np.asarray(self.axis), self.angle, "the line of sight", sight=sight)]
