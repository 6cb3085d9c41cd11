"""Constraints on a motion rather than on where the robot is: clearance, tool speed, torque."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.errors import InvalidGoal
from kinematics.model.chain import Chain
from planning.constraints.kinds.frames import tolerance
from planning.constraints.row import Row


@dataclass(frozen=True, slots=True)
class ClearanceConstraint:
    """Every obstacle stays at least ``margin`` away, beyond its own margin.

    Args:
        margin: [m].

    Raises:
        InvalidGoal: It is negative.
    """

    margin: float
    weight: None = None

    def __post_init__(self) -> None:
        tolerance(self.margin, "margin", 1e6)

    @property
    def name(self) -> str:
        """Name of the constraint."""
        return "clearance"

    def rows(self, chain: Chain) -> list[Row]:  # noqa: ARG002  distances need the scene
        """None: distances need the scene."""
        return []


@dataclass(frozen=True, slots=True)
class ToolSpeedConstraint:
    """The tip moves at ``limit`` at most.

    Args:
        limit: [m/s].

    Raises:
        InvalidGoal: It is not positive.
    """

    limit: float
    weight: None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.limit < np.inf:
            raise InvalidGoal(f"the tool speed limit is {self.limit}; it must be positive [m/s]")

    @property
    def name(self) -> str:
        """Name of the constraint."""
        return "tool speed"

    def rows(self, chain: Chain) -> list[Row]:  # noqa: ARG002  a speed needs time
        """None: a speed needs time."""
        return []


@dataclass(frozen=True, slots=True)
class TorqueConstraint:
    """Joint torques stay within limits.

    Args:
        limits: Limits in the order of the joints [N m or N]; the robot's own where None.

    Raises:
        InvalidGoal: A limit is not positive.
    """

    limits: Sequence[float] | None = None
    weight: None = None

    def __post_init__(self) -> None:
        if self.limits is not None and not all(limit > 0.0 for limit in self.limits):
            raise InvalidGoal("torque limits must be positive [N m or N]")

    @property
    def name(self) -> str:
        """Name of the constraint."""
        return "torque"

    def rows(self, chain: Chain) -> list[Row]:
        """None: torques need the dynamics.

        Raises:
            InvalidGoal: There is not one limit for each joint.
        """
        if self.limits is not None and len(self.limits) != chain.n:
            raise InvalidGoal(
                f"the torque constraint has {len(self.limits)} limit(s), robot {chain.name!r} has "
                f"{chain.n} joints",
                hint=f"The order is: {', '.join(chain.joint_names)}.",
            )
        return []
