"""Timed trajectories and certificates in answers."""

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Field

from armwright_wire.base import Answer, Body, Label, NamePair, NonNegative, PlanId
from armwright_wire.goals.goal import ConstraintUse
from armwright_wire.scenes.check import MAX_ATTACHED, AllowedAnswers
from armwright_wire.scenes.scene import MAX_OBSTACLES

ContentHash = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class ToolToleranceAnswer(Answer):
    """Use of the tolerances of a seam, proved for every instant."""

    share: float
    """largest share of a range on either side of its middle"""
    time: float
    """when [s]"""


class ToolSpeedBandAnswer(Answer):
    """Speed of the tool where one speed is asked for."""

    share: float
    """of the seam's length, on which the speed is proved to be within the band"""
    least: float
    """least speed found, starts and stops included [m/s]"""
    most: float
    """a bound of the largest speed over all t [m/s]"""
    low: float
    """least speed of the band [m/s]"""
    high: float
    """largest, which is a limit [m/s]"""


class ToolSpeedAnswer(ToolSpeedBandAnswer):
    """Speed of the tool along a seam; of several speeds the least and the largest."""

    bands: list[ToolSpeedBandAnswer] | None = None
    """the same for each of the speeds that are asked for, if they differ"""


class PathDeviationAnswer(Answer):
    """Largest deviation of the tool from its motions, proved for every instant."""

    position: float
    """from the line or arc [m]"""
    orientation: float | None
    """[rad]; null where it is free"""
    time: float
    """where it is farthest off [s]"""
    max_position: float
    """what was allowed [m]"""
    max_orientation: float | None
    """what was allowed [rad]"""


class PathNearnessAnswer(Answer):
    """Distance of a motion from a path of waypoints, proved for every instant."""

    tolerance: float
    """the path's [rad or m]"""
    deviation: float | None
    """bound of the distance of any joint from the straight lines through the waypoints, both run
    through in the same order; null where it is not within the tolerance [rad or m]
    """


class LimitUse(Answer):
    """Use of a limit by a motion, from the exact extrema of its polynomials."""

    worst_ratio: float | None
    """1 is the limit itself; null beyond a limit of 0"""
    joint: str
    """the joint that comes nearest to its limit"""
    time: float
    """when it does [s]"""


class LimitUses(Answer):
    """Use of each limit that was proved; null where none is known."""

    position: LimitUse | None = None
    velocity: LimitUse | None = None
    acceleration: LimitUse | None = None
    jerk: LimitUse | None = None
    torque: LimitUse | None = None
    """bounded from above for every instant"""
    tool_speed: LimitUse | None = None
    """bounded from above for every instant"""


class ProvedAnswer(Answer):
    """Parts of a proof that were carried out and hold."""

    limits: bool
    """limits, continuity, constraints and tool motions; false also where a jerk limit is known that
    was not asked for and is not kept
    """
    collisions: bool
    """nothing collides"""
    reasons: list[str]
    """why a part is not proved; and links and obstacles that were not compared, which leaves the
    rest proved
    """


class Premises(Body):
    """Premises of a certificate: of another robot, scene or load it says nothing."""

    robot: Label | None = None
    """name of the robot; null for limits given without one"""
    robot_hash: ContentHash | None = None
    """content hash of the robot with what it holds and its fingers where they stand; of its chain
    alone where collisions were not looked at
    """
    scene: Label | None = None
    """name of the stored scene; null for any other"""
    scene_hash: ContentHash | None = None
    """content hash of the obstacles that are not held, and of the pairs that may touch; null where
    collisions were not looked at
    """
    obstacles: Annotated[int, Field(ge=0, le=MAX_OBSTACLES)] = 0
    """how many these obstacles are"""
    attached: Annotated[list[Label], Field(max_length=MAX_ATTACHED)] = Field(default_factory=list)
    """names of the objects that the robot holds"""
    tool: Label | None = None
    """the link whose frame poses of the tool are of"""
    margin: NonNegative = 0.0
    """kept from obstacles beyond their own margins [m]"""
    open_meshes: Annotated[list[Label], Field(max_length=MAX_OBSTACLES)] = Field(
        default_factory=list
    )
    """meshes taken as open: their inside is not solid"""


#: Kinds of stops; "none" proves none.
Stops: TypeAlias = Annotated[
    Literal["none", "path", "joints", "both"],
    Field(
        description="prove that the arm can come to rest from every instant: along its own path, "
        "with every joint braking by itself at its limits, which leaves the path, or both"
    ),
]


class WorstStopAnswer(Answer):
    """Stop that comes nearest to something, or the first found that is not proved."""

    time: float
    """of the motion, at which braking begins [s]"""
    after: float
    """since then [s]"""
    pair: NamePair | None = None
    """the two bodies; a joint twice where its range is left"""
    clearance: float | None = None
    """of the two, a lower bound where it is proved [m]; of a joint how far it is within its range,
    negative outside [rad or m]; null with nothing to hit
    """


class StopsAnswer(Answer):
    """The proof that a motion can be stopped at every instant."""

    kind: Literal["path", "joints", "both"]
    """of the stops"""
    proved: bool
    """from every instant, each kind"""
    worst: WorstStopAnswer
    """the nearest stop, or the one at fault; of stops along the path alone the longest, with the
    clearance of the motion
    """
    longest: float | None
    """a bound of the longest time to rest [s]; null where none is known"""
    message: str | None = None
    """on what is not proved"""
    slowed: float = 0.0
    """what the motion takes longer so that its stops are proved [s]"""


class CertificateAnswer(Answer):
    """The proof that a motion is valid at every instant, or the first violation."""

    verified: bool
    """all that the request names is proved"""
    proved: ProvedAnswer
    premises: Premises | None = None
    """what all of this holds for; null in answers of older versions"""
    min_clearance: float | None
    """a lower bound for every t [m]; null with nothing to hit"""
    clearance_pair: NamePair | None = None
    """the two bodies that come nearest"""
    min_obstacle_clearance: float | None = None
    """the same from obstacles alone; null without any"""
    min_self_clearance: float | None = None
    """the same among the robot's own links and what it holds; no margin is kept"""
    method: str
    """how motions were proved free of collision"""
    limits: LimitUses | None = None
    continuity: Any = None
    """largest jumps of position and velocity between pieces"""
    path_constraint_residual: float | None = None
    """the worst violation of the hard path constraints over all t [m or rad], bounded from above;
    null without any
    """
    path_constraints: list[ConstraintUse] = Field(default_factory=list)
    """each with the bound of its residual over all t"""
    path_deviation: PathDeviationAnswer | None = None
    """of the tool from the motions of the planner cartesian"""
    path: PathNearnessAnswer | None = None
    """of the joints from the path, where path.tolerance was given"""
    tool_tolerance: ToolToleranceAnswer | None = None
    """use of the tolerances of the planner cartesian"""
    tool_speed: ToolSpeedAnswer | None = None
    """the tool's speed along waypoints of the planner cartesian"""
    cells: int = 0
    """intervals of time that were looked at"""
    violation: dict[str, Any] | None = None
    """the first, with its time"""
    witness: dict[str, Any] | None = None
    """where it was asked for: a file to check the proof by, `compact` as Base64, and what it does
    not show, `unwitnessed`
    """
    frame: str | None = None
    """of an answer to validate: that poses are in"""
    frame_note: str | None = None
    """where the chain begins, if that is not the root frame"""
    notes: list[str] = Field(default_factory=list)
    """what was done to the request"""
    allowed_collisions: AllowedAnswers = Field(default_factory=list)
    stops: StopsAnswer | None = None
    """of its stops; null if not asked for"""
    plan_id: PlanId = None
