"""A point of a link held in a region of space."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kinematics.model.chain import Chain
from planning.constraints.kinds.frames import Attachment, vector, weight
from planning.constraints.kinds.region import Region
from planning.constraints.row import Row


@dataclass(frozen=True, slots=True, eq=False)
class PositionConstraint:
    """A point of a link stays in a region.

    Args:
        region: Region in the frame of the reference.
        link: Link that carries the point; the tip where none is named.
        point: Point in the link's frame, shape (3,) [m].
        reference_link: The link whose frame the region is in; the base where none is named.
        weight: None where it must hold; else what a squared metre of it costs.

    Raises:
        InvalidGoal: The point is not finite, or the weight not positive.
    """

    region: Region
    link: str | None = None
    point: ArrayLike = (0.0, 0.0, 0.0)
    reference_link: str | None = None
    weight: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", vector(self.point, "point"))
        weight(self.weight)

    @property
    def name(self) -> str:
        """Name of the constraint."""
        return f"position of {'the tip' if self.link is None else repr(self.link)}"

    def rows(self, chain: Chain) -> list[Row]:
        """Its rows on a chain.

        Raises:
            InvalidLinkName: No such link.
            InvalidGoal: The link does not move against the reference.
        """
        at = Attachment.of(chain, self.link, self.reference_link)
        return self.region.rows(at, at.point(np.asarray(self.point)))
