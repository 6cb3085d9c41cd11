"""A joint held near a position."""

from dataclasses import dataclass

import numpy as np

from kinematics.errors import InvalidGoal
from kinematics.model.chain import Chain, JointType
from planning.constraints.kinds.frames import tolerance, weight
from planning.constraints.row import Row, RowKind, Unit


@dataclass(frozen=True, slots=True)
class JointConstraint:
    """position - tolerance_below <= q_j <= position + tolerance_above.

    Args:
        joint: Name of the joint.
        position: [rad or m].
        tolerance_above: [rad or m].
        tolerance_below: [rad or m].
        weight: None where it must hold; else what a squared radian or metre of it costs.

    Raises:
        InvalidGoal: A tolerance is negative, or the position not finite.
    """

    joint: str
    position: float
    tolerance_above: float = 0.0
    tolerance_below: float = 0.0
    weight: float | None = None

    def __post_init__(self) -> None:
        if not np.isfinite(self.position):
            raise InvalidGoal(f"the position of joint {self.joint!r} is not finite")
        tolerance(self.tolerance_above, "tolerance_above")
        tolerance(self.tolerance_below, "tolerance_below")
        weight(self.weight)

    @property
    def name(self) -> str:
        """Name of the constraint."""
        return f"joint {self.joint!r}"

    def rows(self, chain: Chain) -> list[Row]:
        """Its rows on a chain.

        Raises:
            InvalidGoal: The chain has no such joint.
        """
        if self.joint not in chain.joint_names:
            raise InvalidGoal(
                f"robot {chain.name!r} has no joint {self.joint!r}",
                hint=f"Its joints are: {', '.join(chain.joint_names)}.",
                joint=self.joint,
                joints=list(chain.joint_names),
            )
        j = chain.joint_names.index(self.joint)
        low, high = self.position - self.tolerance_below, self.position + self.tolerance_above
        kind: Unit = "rad" if chain.joint_types[j] == JointType.REVOLUTE else "m"
        return [Row(RowKind.JOINT, j, -1, low, high, kind, label=f"joint {self.joint!r}")]
