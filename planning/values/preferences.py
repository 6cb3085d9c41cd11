"""Costs by which one of several goal configurations is chosen."""

from dataclasses import dataclass, fields
from math import isfinite

from kinematics.errors import InvalidOption


@dataclass(frozen=True, slots=True)
class GoalCosts:
    """Weights of what a goal configuration costs.

    Args:
        motion_time: Weight of the time of the straight joint motion from the start at the limits of
            velocity and acceleration [1/s].
        joint_limits: Weight of the nearness to a joint limit, 1 at a limit and 0 from 15 % of the
            range.
        manipulability: Weight of its lack, 1 at a singularity and 0 at the best of the
            configurations.
        clearance: Weight of the nearness of obstacles, 1 in contact and 0 from 5 cm.
        turns: Weight of each joint that turns by more than half a turn.

    Raises:
        InvalidOption: A weight is negative or not finite.
    """

    motion_time: float = 1.0
    joint_limits: float = 0.5
    manipulability: float = 0.2
    clearance: float = 0.2
    turns: float = 0.2

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not (isfinite(value) and value >= 0.0):
                raise InvalidOption(
                    f"goal_costs.{item.name} is {value}", hint="Weights are finite, 0 or more."
                )


def time_weight(costs: GoalCosts) -> float:
    """Weight of motion time by which the others become seconds [1/s]; 1 where all weights are 0.

    It is at least a twentieth of the largest of the others: searches are led by least times.
    """
    largest = max(getattr(costs, item.name) for item in fields(costs))
    # Where times are added up, time counts at least this share of the largest of the other weights.
    return max(costs.motion_time, 0.05 * largest) or 1.0
