"""Weights by which one of a pose's configurations is chosen."""

from pydantic import Field

from planning.goal_costs import GoalCosts as DomainCosts
from service.schemas.base import Body, NonNegative

_DEFAULT = DomainCosts()


class GoalCosts(Body):
    """Weights of what a goal configuration costs; those left out keep their default."""

    motion_time: NonNegative = Field(
        _DEFAULT.motion_time,
        description="of the time of the straight joint motion from the start [1/s]",
    )
    joint_limits: NonNegative = Field(
        _DEFAULT.joint_limits,
        description="of the nearness to a joint limit: 1 at a limit, 0 from 15 % of the range",
    )
    manipulability: NonNegative = Field(
        _DEFAULT.manipulability,
        description="of its lack: 1 at a singularity, 0 at the best configuration",
    )
    clearance: NonNegative = Field(
        _DEFAULT.clearance, description="of the nearness of obstacles: 1 in contact, 0 from 5 cm"
    )
    turns: NonNegative = Field(
        _DEFAULT.turns, description="of each joint that turns by more than half a turn"
    )
