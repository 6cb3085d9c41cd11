"""The proof that comes with a motion, and how to ask for one."""

from typing import Any, Literal, TypedDict

from pydantic import Field

from armwright_client.base import (
    Answer,
    InFrame,
    NonNegative,
    Positive,
    Request,
    Vector,
)
from armwright_client.check import AttachedObjects, FingerPositions
from armwright_client.constraint import Constraints, ConstraintUse
from armwright_client.dynamics import Payload
from armwright_client.scene import AllowedPair, AllowedPairs, SceneReference
from armwright_client.seam import ToolSpeed, ToolToleranceUse
from armwright_client.tool_motion import TimedToolMotions
from armwright_client.trajectory import Trajectory

Collisions = Literal["check", "ignore"]


class LimitUse(Answer):
    """Use of a limit by a motion, from the exact extrema of its polynomials.

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
    """Largest deviation of the tool from its motions, proved for every instant.

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


class Proved(Answer):
    """Parts of a proof that were carried out and hold.

    Args:
        limits: Limits, continuity, constraints and tool motions; false also where a jerk limit is
            known that was not asked for and is not kept.
        collisions: Nothing collides.
        reasons: Why a part is not proved.
    """

    limits: bool
    collisions: bool
    reasons: list[str] = Field(default_factory=list)


class Premises(Answer):
    """What a certificate holds for: of another robot, scene or load it says nothing.

    Args:
        robot: Name of the robot; None for limits given without one.
        robot_hash: Of the content of the robot with what it holds and its fingers where they stand;
            of its chain alone where collisions were not looked at.
        scene: Name of the stored scene; None for any other.
        scene_hash: Of the content of the obstacles that are not held, and of the pairs that may
            touch; None where collisions were not looked at.
        obstacles: How many these obstacles are.
        attached: Names of the objects that the robot holds.
        tool: The link whose frame poses of the tool are of.
        margin: Kept from obstacles beyond their own margins [m].
        open_meshes: Meshes taken as open: their inside is not solid.
    """

    robot: str | None
    robot_hash: str | None
    scene: str | None
    scene_hash: str | None
    obstacles: int
    attached: list[str]
    tool: str | None
    margin: float
    open_meshes: list[str] = Field(default_factory=list)


class Certificate(InFrame):
    """The proof that a motion is valid at every instant, or the first violation.

    Args:
        verified: Whether all that the request names was proved.
        proved: Which parts were, and why others were not.
        premises: What all of this holds for; None in answers of older versions.
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
        tool_tolerance: Use of the tolerances of the planner "cartesian".
        tool_speed: The tool's speed along waypoints of that planner.
        cells: Intervals of time that were looked at.
        violation: The first one, with its time, where it was not proved.
        allowed_collisions: All pairs that were not kept apart, with who allows them and how deep.
        plan_id: Of the kept plan, if it was kept.
    """

    verified: bool
    proved: Proved
    premises: Premises | None = None
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
    tool_tolerance: ToolToleranceUse | None = None
    tool_speed: ToolSpeed | None = None
    cells: int | None = None
    violation: dict[str, Any] | None = None
    allowed_collisions: list[AllowedPair] = Field(default_factory=list)
    plan_id: str | None = None


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
        frame: Of what names none: a link that stands still, or "tool" at the start.
        limits: In place of the robot's.
        constraints: That hold along the path.
        attached: Objects that move with a link.
        fingers: Where joints of the gripper stand meanwhile [rad or m].
        allowed_collisions: More pairs that may touch.
        margin: Distance to be kept [m].
        collisions: "ignore" looks at no collisions at all, and the certificate says so.
        tool_motions: Lines and arcs that the tool has to keep to.
        torque_limits: Whether the robot's effort limits hold too.
        payload: What the tip carries, for torques.
        tool_speed: Largest speed of the tip [m/s].
        timeout: [s].
        keep: Whether request and answer are kept as a plan, see `Client.plans`.
    """

    scene: SceneReference
    frame: str
    limits: LimitValues
    constraints: Constraints
    attached: AttachedObjects
    fingers: FingerPositions
    allowed_collisions: AllowedPairs
    margin: float
    collisions: Collisions
    tool_motions: TimedToolMotions
    torque_limits: bool
    payload: Payload
    tool_speed: float
    timeout: float
    keep: bool


class ValidateRequest(Request):
    """A motion to be proved valid, whoever made it; see `ValidateOptions`."""

    robot: str
    trajectory: Trajectory
    scene: SceneReference | None = None
    frame: str | None = None
    limits: LimitValues | None = None
    constraints: Constraints | None = None
    attached: AttachedObjects | None = None
    fingers: FingerPositions | None = None
    allowed_collisions: AllowedPairs | None = None
    margin: NonNegative | None = None
    collisions: Collisions | None = None
    tool_motions: TimedToolMotions | None = None
    torque_limits: bool | None = None
    payload: Payload | None = None
    tool_speed: Positive | None = None
    timeout: Positive | None = None
    keep: bool | None = None
