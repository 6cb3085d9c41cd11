"""Weights by which one of a pose's configurations is chosen."""

from pydantic import Field

from armwright_wire.base import Answer, Body, NonNegative


class GoalCosts(Body):
    """Weights of what a goal configuration costs; those left out keep their default."""

    # Defaults are those of planning; tests compare the two.

    motion_time: NonNegative = Field(
        1.0,
        description="of the time of the straight joint motion from the start [1/s]",
    )
    joint_limits: NonNegative = Field(
        0.5,
        description="of the nearness to a joint limit: 1 at a limit, 0 from 15 % of the range",
    )
    manipulability: NonNegative = Field(
        0.2,
        description="of its lack: 1 at a singularity, 0 at the best configuration",
    )
    clearance: NonNegative = Field(
        0.2, description="of the nearness of obstacles: 1 in contact, 0 from 5 cm"
    )
    turns: NonNegative = Field(0.2, description="of each joint that turns by more than half a turn")


class ConfigurationAnswer(Answer):
    """The configuration that was chosen for a pose, what it costs, and why it is not another."""

    branch: str | None = Field(
        None, description="name of its branch; null where the arm has no closed form"
    )
    limit_share: float = Field(
        description="distance of the joint nearest to its limit, as a share of the joint's range"
    )
    costs: dict[str, float] = Field(
        description="what it costs, weighted, by the names of `goal_costs`; `motion_time` is "
        "that of the straight joint motion to it",
        examples=[{"motion_time": 0.61, "joint_limits": 0.0, "turns": 0.0}],
    )
    found: int = Field(description="free configurations that were found")
    cheaper: int = Field(description="those of them that cost less, clearance left out")
    at_limit: int = Field(description="those of them within 2 % of a joint limit")
    reason: str = Field(
        description="why it was chosen",
        examples=["It costs the least of 8 free configurations."],
    )
