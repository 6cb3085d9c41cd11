"""Tours over many goals on the wire."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import ConfigDict, Field, model_validator

from armwright_wire.base import (
    JOINTS_EXAMPLE,
    Answer,
    Beside,
    BodyWithRules,
    Frame,
    InFrame,
    JointVector,
    Label,
    NonNegative,
    PlanId,
    Positive,
    examples,
)
from armwright_wire.goals.goal import (
    Clearance,
    ConfigurationAnswer,
    Constraints,
    GoalLike,
    SingleGoal,
    Start,
    Tolerance,
    as_goal,
    given_fields,
)
from armwright_wire.motions.certificate import CertificateAnswer
from armwright_wire.motions.trajectory import TrajectoryAnswer
from armwright_wire.plans.plan import PathAnswer, PlanningRequest, Reproducibility
from armwright_wire.pose import PoseInFrame
from armwright_wire.robots.reach import ReachTolerance
from armwright_wire.scenes.check import AllowedAnswers

MAX_GOALS = 500
MAX_ROUNDS = 1_000
MAX_PRECEDENCE = 10_000
#: Configurations and poses of one goal.
MAX_ALTERNATIVES = 100


class TourGoal(BodyWithRules):
    """A goal of a tour: a configuration, a pose that may have free axes, or any of several."""

    one_of: ClassVar[tuple[str, ...]] = ("joints", "state", "pose", "any_of")
    only_beside: ClassVar[Beside] = {
        "position_tolerance": ("pose",),
        "orientation_tolerance": ("pose",),
        "frame": ("pose",),
        "tolerance": ("pose", "any_of"),
    }

    joints: JointVector | None = Field(None, examples=[JOINTS_EXAMPLE])
    """the configuration [rad or m]"""
    state: Label | None = Field(None, examples=["home"])
    """a named state of the robot"""
    pose: PoseInFrame | None = None
    """pose of the tip"""
    any_of: Annotated[list[SingleGoal], Field(min_length=1, max_length=MAX_ALTERNATIVES)] | None = (
        None
    )
    """configurations and poses, of which one is visited"""
    frame: Frame | None = None
    position_tolerance: Tolerance | None = None
    """of the pose [m]"""
    orientation_tolerance: Tolerance | None = None
    """of the pose [rad]"""
    id: Label | None = Field(None, examples=["hole_7"])
    """its name in precedence and in the answer; its number, from 0 on, if left out"""
    tolerance: ReachTolerance | None = None
    """deviation that is allowed from its poses, such as a free spin"""
    dwell: Annotated[NonNegative, Field(le=86_400.0)] = 0.0
    """how long the arm stays there [s]"""
    group: Label | None = Field(None, examples=["left_side"])
    """goals of one group are visited one after another, with no other between them"""

    @model_validator(mode="after")
    def _check_form(self) -> "TourGoal":
        if any(goal.velocities or goal.accelerations for goal in self.any_of or ()):
            raise ValueError("a tour rests at its goals: they have no velocities")
        return self


def as_tour_goal(goal: GoalLike) -> TourGoal:
    """The goal of a tour that is meant by a goal, a pose or a configuration."""
    return TourGoal(**given_fields(as_goal(goal)))


class TourRequest(PlanningRequest):
    """Goals to be visited in the order that takes the least time."""

    model_config = ConfigDict(json_schema_extra={"examples": examples("TourRequest")})

    start: Start | None = None
    """where the tour begins, at rest; at any goal if left out"""
    end: Literal["any", "start"] | Start = Field("any", examples=["start"])
    """where it ends: at any goal, back at the start, or at a configuration"""
    goals: Annotated[list[TourGoal], Field(min_length=2, max_length=MAX_GOALS)]
    """2 to 500 goals, in any order"""
    precedence: Annotated[
        list[Annotated[list[Label], Field(min_length=2, max_length=2)]],
        Field(max_length=MAX_PRECEDENCE),
    ] = Field(default_factory=list, examples=[[["hole_1", "hole_0"]]])
    """pairs of goals or groups: the first is visited before the second"""
    constraints: Constraints | None = None
    clearance: Clearance | None = None
    """distance to be kept wherever there is room; none if left out"""
    start_state_tolerance: Annotated[NonNegative, Field(le=0.1)] | None = None
    """a configuration outside a limit by no more is moved onto it [rad or m]; if left out a start
    or end by 0.01 % of the limit, as measurements miss it, a goal by 1e-6
    """
    rounds: Annotated[int, Field(ge=0, le=MAX_ROUNDS)] = 20
    """rounds of search and proof after the first tour that is proved"""
    leg_timeout: Annotated[Positive, Field(le=600.0)] = 10.0
    """longest that one leg is planned [s]; before that, planners end after a number of edges"""
    allow_partial: bool = False
    """whether a tour that leaves goals out is an answer"""

    @model_validator(mode="after")
    def _check_ends(self) -> "TourRequest":
        for end in (self.start, self.end):
            if isinstance(end, Start) and (end.velocities or end.accelerations):
                raise ValueError("a tour begins and ends at rest: its ends have no velocities")
        if self.timing.times is not None:
            raise ValueError("timing.times belong to one path; a tour has many legs")
        if self.clearance is not None:
            self.clearance.check_margin(self.margin)
        return self


class VisitAnswer(Answer):
    """One goal that is visited."""

    id: str
    """its name"""
    index: int
    """its number in the request"""
    alternative: int
    """which of any_of is taken, 0 without"""
    joints: list[float]
    """the configuration [rad or m]"""
    arrival: float
    """when the arm gets there [s]"""
    departure: float
    """when it goes on [s]"""
    configuration: ConfigurationAnswer | None = None
    """what it costs and why it was chosen; null of a goal without a pose"""


class LegAnswer(Answer):
    """One motion of the tour, from rest to rest."""

    origin: str | None
    """the goal that it comes from; null for the start"""
    target: str | None
    """the goal that it leads to; null for the end"""
    begins: float
    """when [s]"""
    planner: str
    """the stage of planning that found it"""
    path: PathAnswer
    """its corners in joint space"""
    trajectory: TrajectoryAnswer
    """the timed motion, from its own time 0"""
    certificate: CertificateAnswer
    """the proof"""


class UnvisitedAnswer(Answer):
    """A goal that is left out."""

    id: str
    """its name"""
    index: int
    """its number in the request"""
    code: str
    """kind of reason, a problem's code or PREDECESSOR_LEFT_OUT"""
    message: str
    """the reason"""
    details: dict[str, Any]
    """values a program can use"""


class TourImprovementAnswer(Answer):
    """A proved tour that was the best so far: its time and its configurations."""

    round: int
    """round of search and proof that found it"""
    time: float
    """of the whole tour [s]"""


class TourSearchAnswer(Answer):
    """Effort of the search."""

    configurations: int
    """of all goals together that the search chose from"""
    checked: int
    """straight motions that were checked"""
    blocked: int
    """those of them that something is in the way of"""
    planned: int
    """legs that were planned and proved"""
    rounds: int
    """rounds of search and proof"""
    improvements: list[TourImprovementAnswer]
    """proved tours that were the best so far"""
    stopped: Literal["finished", "rounds", "deadline"]
    """why it ended: finished where rounds found nothing shorter"""


class TourAnswer(InFrame):
    """A tour whose every leg is proved."""

    status: Literal["complete", "partial"]
    """partial where goals are left out, or the way to the tour's end"""
    order: list[str]
    """goals in the order of their visit"""
    time: float
    """of the whole tour, stays among them [s]"""
    dwell_time: float
    """of all stays together [s]"""
    lower_bound: float | None
    """no tour over the configurations that were found takes less [s], whatever is in the way; null
    where time was up
    """
    gap: float | None
    """share of the bound by which the tour may be too long at most"""
    visits: list[VisitAnswer]
    """of the goals, in order"""
    legs: list[LegAnswer]
    """the motions, in order"""
    unvisited: list[UnvisitedAnswer]
    """goals that are left out, and why"""
    search: TourSearchAnswer
    joint_names: list[str]
    """base to tip"""
    allowed_collisions: AllowedAnswers = Field(default_factory=list)
    reproducibility: Reproducibility
    plan_id: PlanId = None
