"""Tours over many goals: the goals, the answer and its legs."""

from collections.abc import Sequence
from typing import Any, Literal, TypedDict

from pydantic import Field

from armwright_client.base import Answer, InFrame, NonNegative, Pairs, Positive, Request, Vector
from armwright_client.certificate import Certificate, LimitValues
from armwright_client.check import AttachedObjects
from armwright_client.clearance import Clearance, ConfigurationReport, GoalCosts
from armwright_client.constraint import Constraints
from armwright_client.goal import GoalLike, SingleGoal, Start, as_goal
from armwright_client.plan import JointPath, Reproducibility, Timing
from armwright_client.pose import AnyPose
from armwright_client.reach import ReachTolerance
from armwright_client.scene import AllowedPair, AllowedPairs, SceneReference
from armwright_client.trajectory import TimedTrajectory


class TourGoal(Request):
    """A goal of a tour: a configuration, a pose that may have free axes, or any of several.

    Args:
        joints: The configuration [rad or m].
        state: A named state of the robot in its place.
        pose: Pose of the tip.
        any_of: Configurations and poses, of which one is visited.
        frame: Of the pose: a link that stands still, or "tool" at the start.
        position_tolerance: Of the pose [m].
        orientation_tolerance: Of the pose [rad].
        id: Its name; its number, from 0 on, if left out.
        tolerance: Deviation that is allowed from its poses.
        dwell: How long the arm stays there [s].
        group: Goals of one group are visited one after another.
    """

    joints: Vector | None = None
    state: str | None = None
    pose: AnyPose | None = None
    any_of: list[SingleGoal] | None = None
    frame: str | None = None
    position_tolerance: Positive | None = None
    orientation_tolerance: Positive | None = None
    id: str | None = None
    tolerance: ReachTolerance | None = None
    dwell: NonNegative = 0.0
    group: str | None = None


def as_tour_goal(goal: GoalLike) -> TourGoal:
    """The goal of a tour that is meant by a goal, a pose or a configuration."""
    fields = {name: value for name, value in as_goal(goal) if value is not None}
    return TourGoal(**fields)


class TourOptions(TypedDict, total=False):
    """Options of a tour beyond robot and goals.

    Args:
        start: Where it begins; at any goal if left out.
        end: "any" goal, back at the "start", or a configuration.
        precedence: Pairs of goals or groups: the first is visited before the second.
        scene: What is in the way: a stored scene's name, or a scene.
        frame: Of what names none: a link that stands still, or "tool" at the start.
        attached: Objects that move with a link.
        allowed_collisions: More pairs that may touch.
        constraints: What every leg has to hold.
        margin: Distance to be kept [m].
        clearance: Distance to be kept wherever there is room; none if left out.
        goal_costs: Weights by which configurations of poses are chosen.
        start_state_tolerance: A configuration so little outside a limit is moved onto it
            [rad or m]; if left out a start or end by 0.01 % of the limit, a goal by 1e-6.
        timing: Of every leg.
        limits: Of the joints, in place of the robot's.
        rounds: Of search and proof after the first tour that is proved.
        leg_timeout: Longest that one leg is planned [s].
        allow_partial: Whether a tour that leaves goals out is an answer.
        timeout: For the whole tour [s].
        seed: Of everything random.
        keep: Whether request and answer are kept as a plan, see `Client.plans`.
    """

    start: Start | None
    end: Literal["any", "start"] | Start
    precedence: Sequence[tuple[str, str]]
    scene: SceneReference | None
    frame: str | None
    attached: AttachedObjects | None
    allowed_collisions: AllowedPairs | None
    constraints: Constraints
    margin: float
    clearance: Clearance | None
    goal_costs: GoalCosts | None
    start_state_tolerance: float
    timing: Timing
    limits: LimitValues | None
    rounds: int
    leg_timeout: float
    allow_partial: bool
    timeout: float | None
    seed: int
    keep: bool


class TourRequest(Request):
    """Goals to be visited in the order that takes the least time; see `TourOptions`."""

    robot: str
    goals: list[TourGoal]
    start: Start | None = None
    end: Literal["any", "start"] | Start = "any"
    precedence: Pairs | None = None
    scene: SceneReference | None = None
    frame: str | None = None
    attached: AttachedObjects | None = None
    allowed_collisions: AllowedPairs | None = None
    constraints: Constraints | None = None
    margin: NonNegative | None = None
    clearance: Clearance | None = None
    goal_costs: GoalCosts | None = None
    start_state_tolerance: NonNegative | None = None
    timing: Timing | None = None
    limits: LimitValues | None = None
    rounds: int | None = None
    leg_timeout: Positive | None = None
    allow_partial: bool = False
    timeout: Positive | None = None
    seed: int = 0
    keep: bool | None = None


class Visit(Answer):
    """One goal that is visited.

    Args:
        id: Its name.
        index: Its number in the request.
        alternative: Which of any_of is taken, 0 without.
        joints: The configuration [rad or m].
        arrival: When the arm gets there [s].
        departure: When it goes on [s].
        configuration: What it costs and why it was chosen; None of a goal without a pose.
    """

    id: str
    index: int
    alternative: int
    joints: list[float]
    arrival: float
    departure: float
    configuration: ConfigurationReport | None = None


class Leg(Answer):
    """One motion of a tour, from rest to rest.

    Args:
        origin: The goal that it comes from; None for the start.
        target: The goal that it leads to; None for the end.
        begins: When [s].
        planner: The stage of planning that found it.
        path: Its corners in joint space.
        trajectory: The timed motion, from its own time 0.
        certificate: The proof.
    """

    origin: str | None = None
    target: str | None = None
    begins: float
    planner: str
    path: JointPath
    trajectory: TimedTrajectory
    certificate: Certificate


class Unvisited(Answer):
    """A goal that a tour leaves out.

    Args:
        id: Its name.
        index: Its number in the request.
        code: Kind of reason.
        message: The reason.
        details: Values a program can use.
    """

    id: str
    index: int
    code: str
    message: str
    details: dict[str, Any]


class TourImprovement(Answer):
    """A proved tour that was the best so far: its time and its configurations.

    Args:
        round: Round of search and proof that found it.
        time: Of the whole tour [s].
    """

    round: int
    time: float


class TourSearch(Answer):
    """Effort of the search for a tour.

    Args:
        configurations: Of all goals together that the search chose from.
        checked: Straight motions that were checked.
        blocked: Those of them that something is in the way of.
        planned: Legs that were planned and proved.
        rounds: Rounds of search and proof.
        improvements: Proved tours that were the best so far.
        stopped: "finished", "rounds" or "deadline".
    """

    configurations: int
    checked: int
    blocked: int
    planned: int
    rounds: int
    improvements: list[TourImprovement]
    stopped: str


class Tour(InFrame):
    """A tour whose every leg is proved.

    Args:
        status: "complete", or "partial" where goals are left out, or the way to the tour's end.
        order: Goals in the order of their visit.
        time: Of the whole tour, stays among them [s].
        dwell_time: Of all stays together [s].
        lower_bound: No tour over the configurations that were found takes less [s].
        gap: Share of the bound by which the tour may be too long at most.
        visits: Of the goals, in order.
        legs: The motions, in order.
        unvisited: Goals that are left out, and why.
        search: Effort of the search.
        joint_names: Base to tip.
        allowed_collisions: All pairs that were not kept apart, the deepest they are.
        reproducibility: Seed, hashes and versions that reproduce the answer.
        plan_id: Of the kept plan, if it was kept.
    """

    status: str
    order: list[str]
    time: float
    dwell_time: float
    lower_bound: float | None = None
    gap: float | None = None
    visits: list[Visit]
    legs: list[Leg]
    unvisited: list[Unvisited]
    search: TourSearch
    joint_names: list[str]
    allowed_collisions: list[AllowedPair] = Field(default_factory=list)
    reproducibility: Reproducibility
    plan_id: str | None = None
