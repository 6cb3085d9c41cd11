"""Planning problems and their answers."""

from collections.abc import Sequence
from typing import Any, Literal, TypedDict

from pydantic import Field

from armwright_client.base import (
    Answer,
    InFrame,
    NonNegative,
    Options,
    Positive,
    Request,
    Vector,
)
from armwright_client.certificate import Certificate, Collisions, LimitValues
from armwright_client.check import AttachedObjects, FingerPositions
from armwright_client.clearance import Clearance, ClearanceReport, ConfigurationReport, GoalCosts
from armwright_client.constraint import Constraints
from armwright_client.dynamics import Payload
from armwright_client.goal import Goal, Start
from armwright_client.planner import PlannerName
from armwright_client.scene import AllowedPairs, SceneReference
from armwright_client.seam import StraightOffset, ToolTolerance, Waypoint
from armwright_client.timing import TimingReport
from armwright_client.tool_motion import (
    TimedToolMotion,
    TimedToolMotions,
    ToolMotion,
)
from armwright_client.tool_motion_report import ReferencePose, ToolMotionReport
from armwright_client.trajectory import TimedTrajectory

TimingMethod = Literal["toppra", "spline", "jerk_limited"]
TimingSolver = Literal["reachability", "toppra", "quintic_spline", "double_s", "interior_point"]


class Timing(Request):
    """Options of the timing.

    Args:
        method: Of timing; bounded jerk if left out, "toppra" for the least time.
        solver: Of the method "toppra": "reachability" if left out, or "toppra", the package. Of
            "jerk_limited": "quintic_spline", "double_s" or "interior_point".
        velocity_scaling: Share of the velocity limits to use, up to 1.
        acceleration_scaling: Share of the acceleration limits to use, up to 1.
        jerk_scaling: Share of the jerk limits to use, up to 1.
        times: When each point is passed, for splines [s].
        scale_times: Whether they may be stretched by the least factor that keeps all limits.
        interpolation: How to read between the points.
        blend_tolerance: How far corners may be cut [rad or m].
        torque_limits: Whether torques are limited too.
        payload: What the tip carries, for torques.
        tool_speed: Largest speed of the tip [m/s].
        sample_period: Samples are answered at this period [s], else none.
    """

    method: TimingMethod | None = None
    solver: TimingSolver | None = None
    velocity_scaling: Positive | None = None
    acceleration_scaling: Positive | None = None
    jerk_scaling: Positive | None = None
    times: Vector | None = None
    scale_times: bool | None = None
    interpolation: Literal["linear", "natural_spline", "clamped_spline"] | None = None
    blend_tolerance: NonNegative | None = None
    torque_limits: bool | None = None
    payload: Payload | None = None
    tool_speed: Positive | None = None
    sample_period: Positive | None = None


class CartesianOptions(Request):
    """`planner_options` of the planner "cartesian".

    Args:
        motions: In order; one line to the goal if left out.
        max_deviation: Of the tool's origin from its motion, for every instant [m].
        max_orientation_deviation: Of its orientation from that at the same place [rad].
        orientation: "slerp" about an axis that keeps still, or "free": only the origin is led.
        allow_partial: Whether a motion that ends early is an answer too.
        blend: Distance from corners at which the tool may leave one motion for the next [m]; 0 for
            a rest at every corner.
        waypoints: Of a seam, in place of motions.
        tolerance: Of all waypoints: by how much the tool may deviate; exact if left out.
        tool_speed: To be kept on the way to waypoints that have none of their own [m/s].
        speed_band: Largest difference from it, as part of it.
        approach: Motion to the first waypoint.
        retreat: Motion from the last waypoint.
        branch_changes: Motion away from a waypoint after which the arm may come back in another
            branch; None forbids it.
    """

    motions: list[ToolMotion] | None = None
    max_deviation: Positive = 1e-4
    max_orientation_deviation: Positive = 1e-3
    orientation: Literal["slerp", "free"] = "slerp"
    allow_partial: bool = False
    blend: NonNegative = 0.0
    waypoints: list[Waypoint] | None = None
    tolerance: ToolTolerance | None = None
    tool_speed: Positive | None = None
    speed_band: Positive = 0.1
    approach: StraightOffset | None = None
    retreat: StraightOffset | None = None
    branch_changes: StraightOffset | None = None

    def as_options(self) -> dict[str, Any]:
        """The mapping that a plan's `planner_options` take."""
        return self.model_dump(mode="json", exclude_none=True)

    def seam_in_time(self, reports: Sequence[ToolMotionReport]) -> TimedToolMotions:
        """A seam as a trajectory is held to it, see `Client.validate`.

        Args:
            reports: `tool_motions` of the plan along this seam; of a motion that was recorded
                later, with the times of that one.
        """
        return TimedToolMotions(
            motions=[
                TimedToolMotion(
                    **dict(report.as_motion),
                    start=report.start,
                    begins=report.begins,
                    part=report.part,
                    tolerance=self._tolerance(report),
                    tool_speed=self._tool_speed(report),
                )
                for report in reports
            ],
            ends=[report.ends for report in reports],
            max_deviation=self.max_deviation,
            max_orientation_deviation=self.max_orientation_deviation,
            tolerance=self.tolerance,
            tool_speed=self.tool_speed,
            speed_band=self.speed_band,
        )

    def _tolerance(self, report: ToolMotionReport) -> ToolTolerance | None:
        """That of the waypoint that a part of a seam leads to, where it has one of its own."""
        if self.waypoints is None or report.part != "seam":
            return None
        waypoint = self.waypoints[report.motion + 1]
        free = set(waypoint.free)
        if waypoint.point is not None and waypoint.direction is None:
            # Without a direction any angle about the normal will do.
            free.add("rz")
        if not free:
            return waypoint.tolerance
        given = waypoint.tolerance or self.tolerance or ToolTolerance()
        changes: dict[str, Any] = dict.fromkeys(free & {"x", "y", "z"}, (-1.0, 1.0))
        turns = free - set(changes)
        changes |= dict.fromkeys(turns) | {"free": sorted({*given.free, *turns})}
        return given.model_copy(update=changes)

    def _tool_speed(self, report: ToolMotionReport) -> float | None:
        """The speed to the waypoint that a part of a seam leads to, where it has its own."""
        if self.waypoints is None or report.part != "seam":
            return None
        return self.waypoints[report.motion + 1].tool_speed


Objective = Literal["time", "jerk", "energy", "path_length"]


class Refine(Request):
    """Options of the optimisation before the proof.

    Args:
        objective: What becomes small, or the weight of each.
        duration: The longest the motion may take [s].
        degree: Of the spline.
        control_points: Of each joint.
        rounds: Convex problems solved at most.
        solver: Of each round.
    """

    objective: Objective | dict[Objective, NonNegative] = "time"
    duration: Positive | None = None
    degree: int | None = None
    control_points: int | None = None
    rounds: int | None = None
    solver: Literal["piqp", "ipopt"] | None = None


class PlanOptions(TypedDict, total=False):
    """Options of a plan beyond robot, start and goal.

    Args:
        scene: What is in the way: a stored scene's name, or a scene.
        frame: Of what names none: a link that stands still, or "tool" at the start.
        planner: "auto" if left out.
        planner_options: The planner's own.
        refine: Whether, or how, the motion that was found is optimised.
        constraints: That hold along the path.
        attached: Objects that move with a link.
        fingers: Where joints of the gripper stand meanwhile [rad or m].
        allowed_collisions: More pairs that may touch.
        margin: Distance to be kept [m].
        clearance: Distance to be kept wherever there is room.
        goal_costs: Weights by which one of a pose's configurations is chosen.
        collisions: "ignore" looks at no collisions at all, and the certificate says so.
        start_state_tolerance: A start or goal so little outside a limit is moved onto it
            [rad or m]; if left out a start by 0.01 % of the limit, a goal by 1e-6.
        timing: How the path becomes a motion.
        limits: Of the joints, in place of the robot's.
        timeout: For all stages together [s].
        seed: Of the random generators.
        keep: Whether request and answer are kept as a plan, see `Client.plans`.
    """

    scene: SceneReference
    frame: str
    planner: PlannerName
    planner_options: Options
    refine: bool | Refine
    constraints: Constraints
    attached: AttachedObjects
    fingers: FingerPositions
    allowed_collisions: AllowedPairs
    margin: float
    clearance: Clearance
    goal_costs: GoalCosts
    collisions: Collisions
    start_state_tolerance: float
    timing: Timing
    limits: LimitValues
    timeout: float
    seed: int
    keep: bool


class PlanRequest(Request):
    """A motion to be planned; see `PlanOptions`."""

    robot: str
    start: Start
    goal: Goal
    scene: SceneReference | None = None
    frame: str | None = None
    planner: PlannerName = "auto"
    planner_options: Options | None = None
    refine: bool | Refine | None = None
    constraints: Constraints | None = None
    attached: AttachedObjects | None = None
    fingers: FingerPositions | None = None
    allowed_collisions: AllowedPairs | None = None
    margin: NonNegative | None = None
    clearance: Clearance | None = None
    goal_costs: GoalCosts | None = None
    collisions: Collisions | None = None
    start_state_tolerance: NonNegative | None = None
    timing: Timing | None = None
    limits: LimitValues | None = None
    timeout: Positive | None = None
    seed: int = 0
    keep: bool | None = None


class Stage(Answer):
    """One stage of planning: its outcome and time [ms]."""

    name: str
    outcome: str
    milliseconds: float
    detail: str | None = None


class JointPath(Answer):
    """The corners of a path in joint space, and its length there."""

    joints: list[list[float]]
    length: float


class Reproducibility(Answer):
    """Seed, hashes and versions that reproduce the answer.

    Args:
        deterministic: Whether the same request gives the same answer: no search was ended by time.
    """

    seed: int
    deterministic: bool = True
    robot_hash: str
    scene_hash: str
    request_hash: str
    versions: dict[str, str]


class Descent(Answer):
    """Course of a potential field's descent before the path was shortened.

    Args:
        joints: The configurations it was in [rad or m].
        potentials: At each of them [J].
        iterations: Steps taken.
    """

    joints: list[list[float]]
    potentials: list[float]
    iterations: int


class Progress(Answer):
    """A path that was the shortest so far, of a planner that goes on after the first.

    Args:
        milliseconds: Since the planner began [ms].
        edges: Looked at until then.
        length: Of the path in joint space.
    """

    milliseconds: float
    edges: int
    length: float


class Plan(InFrame):
    """A certified motion.

    Args:
        status: "success".
        planner: The stage that found it.
        stages: What each stage did, in order.
        path: Its corners.
        trajectory: The timed motion.
        certificate: The proof that it is valid at every instant.
        reproducibility: Seed, hashes and versions that reproduce the answer.
        fraction: How much of the motions of the planner "cartesian" was carried out.
        tool_motions: What became of each.
        reference: Poses that they hold the tool to, at drawn instants.
        stopped: Why they end early, where they do.
        potential_field: Where it went, if a potential field found the path.
        progress: The shortest paths over time, of planners that improve theirs.
        clearance: Where it is nearer to something than preferred.
        configuration: The one of a pose that it ends in; None where no pose left a choice.
        plan_id: Of the kept plan, if it was kept.
        timing: Method and limits that it was timed by.
    """

    status: str
    planner: str
    stages: list[Stage]
    path: JointPath
    trajectory: TimedTrajectory
    certificate: Certificate
    reproducibility: Reproducibility
    fraction: float | None = None
    tool_motions: list[ToolMotionReport] | None = None
    reference: list[ReferencePose] | None = None
    stopped: dict[str, Any] | None = None
    potential_field: Descent | None = None
    progress: list[Progress] = Field(default_factory=list)
    clearance: ClearanceReport | None = None
    configuration: ConfigurationReport | None = None
    plan_id: str | None = None
    timing: TimingReport | None = None
