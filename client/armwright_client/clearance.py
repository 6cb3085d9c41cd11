"""Preferred clearance of plans, and costs of their goal configurations."""

from armwright_client.base import Answer, NonNegative, Request


class Clearance(Request):
    """Distances from obstacles: one to keep wherever there is room, one to keep always.

    Args:
        preferred: Kept wherever there is room [m]; 0 prefers no distance.
        least: Kept always, another name of a plan's `margin` [m].
    """

    preferred: NonNegative = 0.02
    least: NonNegative | None = None


class GoalCosts(Request):
    """Weights of what one of a pose's configurations costs.

    Args:
        motion_time: Of the time of the straight joint motion from the start [1/s].
        joint_limits: Of the nearness to a joint limit.
        manipulability: Of its lack.
        clearance: Of the nearness of obstacles.
        turns: Of each joint that turns by more than half a turn.
    """

    motion_time: NonNegative = 1.0
    joint_limits: NonNegative = 0.5
    manipulability: NonNegative = 0.2
    clearance: NonNegative = 0.2
    turns: NonNegative = 0.2


class ConfigurationReport(Answer):
    """The configuration that was chosen for a pose, what it costs, and why it is not another.

    Args:
        branch: Name of its branch of the closed form; None where the arm has none.
        limit_share: Distance of the joint nearest to its limit, as a share of the joint's range.
        costs: What it costs, weighted, by the names of `GoalCosts`.
        found: Free configurations that were found.
        cheaper: Those of them that cost less, clearance left out.
        at_limit: Those of them within 2 % of a joint limit.
        reason: Why it was chosen.
    """

    branch: str | None = None
    limit_share: float
    costs: dict[str, float]
    found: int
    cheaper: int
    at_limit: int
    reason: str


class CloseSpan(Answer):
    """A span of a motion that is nearer to something than preferred.

    Args:
        begins: When it begins [s].
        ends: When it ends [s].
        distance: The least in it, margins of obstacles taken off [m].
        pair: The two bodies that come so near.
    """

    begins: float
    ends: float
    distance: float
    pair: tuple[str, str]


class ClearanceReport(Answer):
    """Preferred distances, and where a motion does not keep them.

    Args:
        preferred: From obstacles [m].
        own_links: Between the robot's own links [m].
        least: The margin that the certificate proves [m].
        time_below: Time in which the motion is nearer than preferred [s].
        period: Between two instants that were looked at [s].
        spans: Where the motion is nearer, in order.
    """

    preferred: float
    own_links: float
    least: float
    time_below: float
    period: float
    spans: list[CloseSpan]
