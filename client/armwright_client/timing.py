"""The account of a motion's timing in answers."""

from pydantic import Field

from armwright_client.base import Answer


class RuledLimits(Answer):
    """Limits that are not known and follow a rule.

    Args:
        rule: Such as "10 x acceleration".
        joints: Names of the joints that it makes limits for.
    """

    rule: str
    joints: list[str]


class TimingReport(Answer):
    """Method and limits that a motion was timed by.

    Args:
        method: The method of timing.
        solver: Who found the speeds; None where there is no choice.
        limits: Velocity, acceleration and jerk of each joint, scaled; None for no limit.
        ruled: Limits that the robot lacks, by quantity.
    """

    method: str
    solver: str | None = None
    limits: dict[str, list[float | None]]
    ruled: dict[str, RuledLimits] = Field(default_factory=dict)
