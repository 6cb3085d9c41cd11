"""A link held near a pose in the frame of another link, or of the base."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidGoal
from kinematics.model.chain import Chain
from kinematics.pose import from_matrix, transform
from planning.constraints.kinds.frames import Attachment, tolerances, weight
from planning.constraints.kinds.orientation import rotation_rows
from planning.constraints.kinds.region import BoxRegion
from planning.constraints.row import Row


@dataclass(frozen=True, slots=True, eq=False)
class RelativePoseConstraint:
    """A link stays near a pose: its origin within a box, its rotation within axis tolerances.

    Args:
        T_reference_link: The pose in the frame of the reference, shape (4, 4).
        link: The link; the tip where none is named.
        reference_link: The link the pose is seen from; the base where none is named.
        position_tolerances: Position tolerances along x, y and z of the pose, inf where free; one
            number for all [m].
        orientation_tolerances: Tolerances about x, y and z of it, pi or more where free; or one
            number [rad].
        weight: None where it must hold; else what a squared metre or radian of it costs.

    Raises:
        InvalidPose: The pose's rotation is none.
        InvalidGoal: It is no finite transform, or a tolerance is negative.
    """

    T_reference_link: Array
    link: str | None = None
    reference_link: str | None = None
    position_tolerances: ArrayLike = 0.0
    orientation_tolerances: ArrayLike = 0.0
    weight: float | None = None

    def __post_init__(self) -> None:
        T = np.array(self.T_reference_link, dtype=np.float64)
        if T.shape != (4, 4) or not np.isfinite(T).all():
            raise InvalidGoal("a relative pose must be a finite 4x4 transform")
        T = transform(from_matrix(T[:3, :3]), T[:3, 3])
        object.__setattr__(self, "T_reference_link", frozen(T))
        for name in ("position_tolerances", "orientation_tolerances"):
            given = np.asarray(getattr(self, name), dtype=np.float64)
            object.__setattr__(self, name, tolerances(given, name))
        weight(self.weight)

    @property
    def name(self) -> str:
        """Name of the constraint."""
        seen_from = "the base" if self.reference_link is None else repr(self.reference_link)
        return (
            f"pose of {'the tip' if self.link is None else repr(self.link)} seen from {seen_from}"
        )

    def rows(self, chain: Chain) -> list[Row]:
        """A row for each axis that is not free.

        Raises:
            InvalidLinkName: No such link.
            InvalidGoal: Both links move with the same joint.
        """
        at = Attachment.of(chain, self.link, self.reference_link)
        box = BoxRegion(self.T_reference_link, 2.0 * np.asarray(self.position_tolerances))
        turns = np.minimum(np.asarray(self.orientation_tolerances), math.pi)
        rows = box.rows(at, at.point(np.zeros(3)))
        return rows + rotation_rows(at, self.T_reference_link[:3, :3], turns)
