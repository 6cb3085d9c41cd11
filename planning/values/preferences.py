"""Costs by which one of several goal configurations is chosen."""

from dataclasses import dataclass, field, fields
from math import isfinite
from typing import Literal

from kinematics.errors import InvalidOption

#: "path": the arm comes to rest along its own path; "joints": every joint brakes by itself.
StopKind = Literal["path", "joints"]
#: Those that are asked of a motion.
StopKinds = Literal["none", "path", "joints", "both"]


#: Preferred distance from obstacles where none is asked for [m].
DEFAULT_PREFERRED = 0.02
#: Largest distance that can be preferred [m].
MAX_PREFERRED = 1.0


@dataclass(frozen=True, slots=True)
class PreferredClearance:
    """Distances to be kept wherever there is space.

    Args:
        obstacles: Distance from obstacles, their own margins not counted [m]; 0 for none.

    Raises:
        InvalidOption: The distance is not in [0, 1].
    """

    obstacles: float = DEFAULT_PREFERRED
    #: Between the robot's own links [m].
    own_links: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not 0.0 <= self.obstacles <= MAX_PREFERRED:
            raise InvalidOption(
                f"clearance.preferred must be from 0 to {MAX_PREFERRED:g} m",
                hint="Two centimetres are usual; 0 prefers no distance.",
            )
        # A part of the distance from obstacles, and at most so much [m]: a wrist's links are built
        # 10 to 25 mm apart.
        object.__setattr__(self, "own_links", min(0.25 * self.obstacles, 0.005))


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
