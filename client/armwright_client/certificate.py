"""The proof that comes with a motion, and how to ask for one."""

from typing import Any, TypedDict

from pydantic import Field

from armwright_client.base import (
    Answer,
    NonNegative,
    Pairs,
    Positive,
    Request,
    Vector,
)
from armwright_client.check import AttachedObjects
from armwright_client.constraint import Constraints, ConstraintUse
from armwright_client.scene import SceneReference
from armwright_client.trajectory import Trajectory


class LimitUse(Answer):
    """How close a motion comes to a limit, from the exact extrema of its polynomials.

    Args:
        worst_ratio: 1 is the limit itself; None beyond a limit of 0.
        joint: Which comes closest.
        time: When [s].
    """

    worst_ratio: float | None
    joint: str
    time: float


class LimitUses(Answer):
    """Use of each limit that was looked at."""

    position: LimitUse | None = None
    velocity: LimitUse | None = None
    acceleration: LimitUse | None = None
    jerk: LimitUse | None = None
    torque: LimitUse | None = None
    tool_speed: LimitUse | None = None


class PathDeviation(Answer):
    """How far the tool is off its motions at most, proved for every instant.

    Args:
        position: From the line or arc [m].
        orientation: From that at the same place [rad]; None where it is free.
        time: Where it is farthest off [s].
        max_position: What was allowed [m].
        max_orientation: What was allowed [rad].
    """

    position: float
    orientation: float | None = None
    time: float
    max_position: float
    max_orientation: float | None = None


class Certificate(Answer):
    """The proof that a motion is valid at every instant, or the first violation.

    Args:
        verified: Whether it was proved.
        min_clearance: A lower bound of the distances for every t [m]; None with nothing to hit.
        clearance_pair: The two that come closest.
        min_obstacle_clearance: The bound from obstacles alone [m]; None without any.
        min_self_clearance: The bound among the robot's own links and what it holds [m].
        method: How it was proved.
        limits: How much of each is used.
        continuity: Of position and its derivatives across pieces.
        path_constraint_residual: Bound of the largest violation of hard path constraints.
        path_constraints: Each with the bound of its residual over all t.
        path_deviation: Of the tool from the motions of the planner "cartesian".
        cells: Intervals of time that were looked at.
        violation: The first one, with its time, where it was not proved.
        allowed_collisions: Of the request: pairs that were not looked at.
    """

    verified: bool
    min_clearance: float | None = None
    clearance_pair: tuple[str, str] | None = None
    min_obstacle_clearance: float | None = None
    min_self_clearance: float | None = None
    method: str = ""
    limits: LimitUses | None = None
    continuity: Any = None
    path_constraint_residual: float | None = None
    path_constraints: list[ConstraintUse] = Field(default_factory=list)
    path_deviation: PathDeviation | None = None
    cells: int | None = None
    violation: dict[str, Any] | None = None
    allowed_collisions: list[tuple[str, str]] = Field(default_factory=list)


class LimitValues(Request):
    """Limits in the order of the joints, in place of the robot's."""

    velocity: Vector | None = None
    acceleration: Vector | None = None
    jerk: Vector | None = None
    effort: Vector | None = None


class ValidateOptions(TypedDict, total=False):
    """Options of `validate`: margins, limits and constraints beyond the robot's own limits.

    Args:
        scene: What it must not hit.
        limits: In place of the robot's.
        constraints: That hold along the path.
        attached: Objects that move with a link.
        allowed_collisions: More pairs that may touch.
        margin: Distance to be kept [m].
        timeout: [s].
    """

    scene: SceneReference
    limits: LimitValues
    constraints: Constraints
    attached: AttachedObjects
    allowed_collisions: Pairs
    margin: float
    timeout: float


class ValidateRequest(Request):
    """A motion to be proved valid, whoever made it; see `ValidateOptions`."""

    robot: str
    trajectory: Trajectory
    scene: SceneReference | None = None
    limits: LimitValues | None = None
    constraints: Constraints | None = None
    attached: AttachedObjects | None = None
    allowed_collisions: Pairs | None = None
    margin: NonNegative | None = None
    timeout: Positive | None = None
