"""Planning problems, timed motions and their certificates on the wire."""

from typing import Annotated, Any, Literal, TypeAlias, get_args

from pydantic import ConfigDict, Field, model_validator

from armwright_wire.base import (
    Answer,
    Body,
    FreeForm,
    InFrame,
    Keepable,
    Name,
    NonNegative,
    PlanId,
    Positive,
    Seed,
    examples,
)
from armwright_wire.goals.goal import (
    Clearance,
    ClearanceAnswer,
    ConfigurationAnswer,
    Constraints,
    Goal,
    GoalCosts,
    Start,
)
from armwright_wire.goals.tool_motion import (
    ReferencePoseAnswer,
    TimedToolMotions,
    ToolMotionAnswer,
    cartesian_options,
)
from armwright_wire.motions.certificate import CertificateAnswer, Stops
from armwright_wire.motions.retime import PathToKeep, PathTolerance
from armwright_wire.motions.timing import Timing, TimingAnswer
from armwright_wire.motions.trajectory import LimitsBody, TrajectoryAnswer, TrajectoryBody
from armwright_wire.robots.payload import Payload
from armwright_wire.scenes.check import SceneRequest, WithFingers

Tolerance = Annotated[Positive, Field(le=10.0)]
Witness = Annotated[
    bool,
    Field(
        description="answer `witness` in the certificate, from which anybody can check it without "
        "this service"
    ),
]
Collisions = Annotated[
    Literal["check", "ignore"],
    Field(
        description="ignore: collisions of bodies are not looked at, and the certificate says so; "
        "needed for a robot without collision geometry among obstacles. They still push the "
        "control points of the planner potential_field"
    ),
]


Objective = Literal["time", "jerk", "energy", "path_length"]


class Refine(Body):
    """Options of the optimisation before the proof."""

    objective: Objective | Annotated[dict[Objective, NonNegative], Field(min_length=1)] = Field(
        "time", examples=["time", {"time": 1.0, "jerk": 1e-6}]
    )
    """what becomes small: time T [s], jerk ∫|q⃛|²dt, energy ∫|τ|²dt, path_length ∫|dq|; or the
    weight of each
    """
    duration: Positive | None = None
    """the longest the motion may take [s]"""
    degree: Annotated[int, Field(ge=3, le=7)] | None = None
    """of the spline; 3, for jerk 5, if left out"""
    control_points: Annotated[int, Field(ge=8, le=64)] | None = None
    """of each joint; 16 if left out"""
    rounds: Annotated[int, Field(ge=1, le=100)] | None = None
    """convex problems solved at most; 12 if left out"""
    solver: Literal["piqp", "ipopt"] | None = None
    """of each round; piqp if left out, which is faster"""


#: Planners by the names of the service, as the contract lists them.
Planner = Literal[
    "auto",
    "straight_line",
    "potential_field",
    "rrt_connect",
    "aorrtc",
    "bfmt",
    "bit_star",
    "bkpiece1",
    "fmt",
    "informed_rrt_star",
    "kpiece1",
    "lbkpiece1",
    "prm",
    "prm_star",
    "rrt",
    "rrt_star",
    "sorrt_star",
    "optimize",
    "cartesian",
]
PLANNERS: tuple[str, ...] = get_args(Planner)
#: Planners as OMPL writes its own.
OmplPlanner = Literal[
    "RRTConnect",
    "AORRTC",
    "BFMT",
    "BITstar",
    "BKPIECE1",
    "FMT",
    "InformedRRTstar",
    "KPIECE1",
    "LBKPIECE1",
    "PRM",
    "PRMstar",
    "RRT",
    "RRTstar",
    "SORRTstar",
]
#: Names for type checkers and editors; a service lists its own.
PlannerName: TypeAlias = Planner | OmplPlanner
# The service adds the options of OMPL's planners to its document.
_OPTIONS = (
    "Of the planner that is named.\n"
    "* `cartesian`: motions [{type: lin | circ, pose, via, center, normal, blend}], max_deviation, "
    "max_orientation_deviation, orientation, allow_partial, blend; or waypoints [{pose | point, "
    "normal, direction; via, tolerance, free, blend, tool_speed}], tolerance {x, y, z, rx, ry, rz, "
    "free, tilt, frame}, tool_speed, speed_band, approach, retreat {direction, distance, frame}\n"
    "* `potential_field`: the fields of PotentialOptions; of the descent step_sizes (α_k: a number "
    "or a list whose last is kept; if left out the longest steps that lower U), longest_step "
    "(0.05), halvings (6), tolerance (0.01), connect (true), keep_path (false), max_iterations "
    "(1000), patience (50), progress (0.0), force_tolerance (0.001), escapes (0), escape_steps "
    "(6); engine (`exact`, `fcl`); fallback: OMPL's planner that plans where the field is stuck "
    "(`rrt_connect`), null for none"
)


class PlanningRequest(SceneRequest, Keepable):
    """A request for motions of a robot."""

    robot: Name = Field(examples=["panda"])
    """name of a stored or built-in robot"""
    timing: Timing = Field(default_factory=Timing)
    """method and options of the timing"""
    limits: LimitsBody | None = None
    """limits in the order of the joints, in place of the robot's"""
    goal_costs: GoalCosts | None = None
    stops: Stops = "none"
    witness: Witness = False
    seed: Seed = 0


class PlanRequest(PlanningRequest, WithFingers):
    """A motion to be planned."""

    model_config = ConfigDict(json_schema_extra={"examples": examples("PlanRequest")})

    start: Start
    goal: Goal
    planner: Annotated[str, Field(pattern=r"^[A-Za-z0-9_]{1,64}$")] = Field(
        "auto",
        description=f"one of: {', '.join(PLANNERS)}; OMPL's may be written as OMPL writes them "
        "(RRTConnect)",
        examples=["auto", "rrt_connect", "bit_star"],
    )
    planner_options: FreeForm | None = Field(
        None, description=_OPTIONS, examples=[{"range": 0.5}, {"cost_threshold": 3.0}]
    )
    refine: bool | Refine | None = None
    """optimise what the planner found; true for the least time"""
    constraints: Constraints | None = None
    clearance: Clearance | None = None
    collisions: Collisions = "check"
    start_state_tolerance: Annotated[NonNegative, Field(le=0.1)] | None = None
    """a start or goal outside a limit by no more is moved onto it [rad or m]; if left out a start
    by 0.01 % of the limit, as measurements miss it, a goal by 1e-6
    """
    path: PathTolerance | None = None
    """keep the motion near path.joints of the answer, proved: the path that is found, for keep_path
    of a potential field the descent's own; where refine, cartesian or braking leave that, few
    waypoints of the motion
    """

    @model_validator(mode="before")
    @classmethod
    def _goal_of_waypoints(cls, values: Any) -> Any:
        """With waypoints the last one is the goal where none is given."""
        if not isinstance(values, dict) or "goal" in values:
            return values
        options = values.get("planner_options")
        waypoints = options.get("waypoints") if isinstance(options, dict) else None
        if waypoints == []:
            raise ValueError("planner_options.waypoints is empty: a seam has two at least")
        last = waypoints[-1] if isinstance(waypoints, list) and waypoints else None
        if not isinstance(last, dict) or str(values.get("planner")).lower() != "cartesian":
            return values
        pose = last.get("pose") or {"position": last.get("point")}
        return {**values, "goal": {"pose": pose}}

    @model_validator(mode="after")
    def _check_options(self) -> "PlanRequest":
        if self.planner.lower() == "cartesian":
            cartesian_options(self.planner_options)
        if self.clearance is not None:
            self.clearance.check_margin(self.margin)
        return self


class ValidateRequest(SceneRequest, WithFingers, Keepable):
    """A motion to be proved valid, whoever made it."""

    robot: Name = Field(examples=["panda"])
    """name of a stored or built-in robot"""
    trajectory: TrajectoryBody
    path: PathToKeep | None = None
    """waypoints that the motion has to be near"""
    limits: LimitsBody | None = None
    constraints: Constraints | None = None
    collisions: Collisions = "check"
    tool_motions: TimedToolMotions | None = None
    """lines and arcs that the tool has to keep to"""
    torque_limits: bool | None = None
    """hold it to the robot's effort limits too"""
    payload: Payload | None = None
    """what the tip carries, for torques"""
    tool_speed: Positive | None = None
    """largest speed of the tip [m/s]"""
    stops: Stops = "none"
    witness: Witness = False


class Stage(Answer):
    """One stage of planning: outcome and time."""

    name: str = Field(examples=["rrt_connect"])
    """of the stage"""
    outcome: str = Field(examples=["succeeded"])
    """succeeded, or how it failed"""
    milliseconds: float
    """that it took"""
    detail: str | None = None
    """of the outcome, in words"""


class PathAnswer(Answer):
    """The corners of the path in joint space."""

    joints: list[list[float]]
    """corners, from the start to the goal"""
    length: float
    """Euclidean, in joint space"""


class Reproducibility(Answer):
    """Seed, hashes and versions that reproduce the answer."""

    seed: int
    """of the random choices"""
    deterministic: bool = True
    """whether the same request gives the same answer; false where time or memory ended a search, so
    that the answer depends on the speed of the machine
    """
    robot_hash: str
    """content hash of the robot"""
    scene_hash: str
    """content hash of the scene"""
    request_hash: str
    """content hash of the request"""
    versions: dict[str, str]
    """of Armwright and of the libraries that computed"""


class DescentAnswer(Answer):
    """Course of a potential field's descent before the path was shortened."""

    joints: list[list[float]]
    """configurations on the way"""
    potentials: list[float]
    """U at each configuration [J]"""
    iterations: int
    """steps taken"""


class ProgressAnswer(Answer):
    """A path that was the shortest so far, of a planner that goes on after the first."""

    milliseconds: float
    """since the planner began"""
    edges: int
    """looked at until then"""
    length: float
    """of the path, Euclidean in joint space"""


class PlanAnswer(InFrame):
    """A certified motion."""

    status: Literal["success"]
    """success; a problem document has a number here"""
    planner: str
    """the stage that found it"""
    stages: list[Stage]
    """steps of planning, in their order"""
    path: PathAnswer
    trajectory: TrajectoryAnswer
    certificate: CertificateAnswer
    reproducibility: Reproducibility
    fraction: float | None = None
    """how much of the motions of the planner cartesian was carried out"""
    tool_motions: list[ToolMotionAnswer] | None = None
    """of that planner"""
    reference: list[ReferencePoseAnswer] | None = None
    """poses that they hold the tool to, at drawn instants"""
    stopped: dict[str, Any] | None = None
    """why they end early: reason, message, motion, nearest, …"""
    potential_field: DescentAnswer | None = None
    """where it went, if a potential field found the path"""
    progress: list[ProgressAnswer] = Field(default_factory=list)
    """shortest paths over time, of planners that improve"""
    clearance: ClearanceAnswer | None = None
    configuration: ConfigurationAnswer | None = None
    """the one of a pose that it ends in; null where no pose left a choice"""
    plan_id: PlanId = None
    timing: TimingAnswer | None = None
    """method and limits of its timing"""
