"""Planning problems and their answers."""

from collections.abc import Sequence
from typing import Annotated, Any, Literal, Self, TypeAlias, TypedDict

from pydantic import Field, model_validator

from armwright_client.base import (
    Answer,
    NonNegative,
    Options,
    Pairs,
    Positive,
    Request,
    Rows,
    Vector,
    Vector3,
    VectorLike,
)
from armwright_client.certificate import Certificate, LimitValues
from armwright_client.check import AttachedObjects
from armwright_client.constraint import Constraints
from armwright_client.dynamics import Payload
from armwright_client.pose import Pose
from armwright_client.problem import Problem
from armwright_client.scene import SceneReference
from armwright_client.trajectory import TimedTrajectory

TimingMethod = Literal["toppra", "spline", "jerk_limited"]


class Start(Request):
    """Where a motion begins.

    Args:
        joints: The configuration [rad or m].
        velocities: There, for a motion that is optimised; at rest if left out.
        accelerations: There, likewise; any that keep the limits if left out.
    """

    joints: Vector
    velocities: Vector | None = None
    accelerations: Vector | None = None


class SingleGoal(Request):
    """A configuration, or a pose of the tip within tolerances [m, rad]."""

    joints: Vector | None = None
    velocities: Vector | None = None
    accelerations: Vector | None = None
    pose: Pose | None = None
    position_tolerance: Positive | None = None
    orientation_tolerance: Positive | None = None

    @model_validator(mode="after")
    def _check_form(self) -> Self:
        given = [name for name in self._forms() if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"give exactly one of {', '.join(self._forms())}")
        return self

    @classmethod
    def _forms(cls) -> tuple[str, ...]:
        return ("joints", "pose")


class Goal(SingleGoal):
    """Where a motion ends: one goal, or any of several."""

    any_of: list[SingleGoal] | None = None

    @classmethod
    def _forms(cls) -> tuple[str, ...]:
        return ("joints", "pose", "any_of")

    @classmethod
    def at_joints(
        cls,
        joints: VectorLike,
        *,
        velocities: VectorLike | None = None,
        accelerations: VectorLike | None = None,
    ) -> Self:
        """A configuration as the goal [rad or m], for an optimised motion passed at a velocity."""
        return cls.of(joints=joints, velocities=velocities, accelerations=accelerations)

    @classmethod
    def at_pose(
        cls,
        pose: Pose,
        *,
        position_tolerance: float | None = None,
        orientation_tolerance: float | None = None,
    ) -> Self:
        """A pose of the tip as the goal, within tolerances [m, rad]."""
        return cls(
            pose=pose,
            position_tolerance=position_tolerance,
            orientation_tolerance=orientation_tolerance,
        )

    @classmethod
    def among(cls, goals: Sequence["GoalLike"]) -> Self:
        """Whichever of several goals is reached best."""
        return cls(any_of=[SingleGoal(**_given(as_goal(goal))) for goal in goals])


#: A goal, or a pose or configuration that is one.
GoalLike: TypeAlias = SingleGoal | Pose | VectorLike


def as_goal(goal: GoalLike) -> Goal:
    """The goal that is meant by a pose or a configuration."""
    if isinstance(goal, Goal):
        return goal
    if isinstance(goal, SingleGoal):
        return Goal(**_given(goal))
    if isinstance(goal, Pose):
        return Goal.at_pose(goal)
    return Goal.at_joints(goal)


def _given(goal: SingleGoal) -> dict[str, Any]:
    return {name: value for name, value in goal if value is not None}


class Timing(Request):
    """How a path becomes a motion in time.

    Args:
        method: Of timing.
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

    method: TimingMethod = "toppra"
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


class ToolMotion(Request):
    """A line, or an arc through a point or about a centre, from where the tool is.

    Args:
        type: "lin" or "circ".
        pose: Of the tip where the motion ends.
        via: Point on the arc.
        center: Of the arc.
        normal: With the centre: axis to turn about by the right hand, up to a whole turn; the
            shorter arc if left out.
    """

    type: Literal["lin", "circ"]
    pose: Pose
    via: Vector3 | None = None
    center: Vector3 | None = None
    normal: Vector3 | None = None

    @classmethod
    def lin(cls, pose: Pose) -> Self:
        """A line to a pose."""
        return cls(type="lin", pose=pose)

    @classmethod
    def circ(
        cls,
        pose: Pose,
        *,
        via: VectorLike | None = None,
        center: VectorLike | None = None,
        normal: VectorLike | None = None,
    ) -> Self:
        """An arc to a pose, through a point or about a centre."""
        return cls.of(type="circ", pose=pose, via=via, center=center, normal=normal)


class CartesianOptions(Request):
    """What `planner_options` are for the planner "cartesian".

    Args:
        motions: In order; one line to the goal if left out.
        max_deviation: Of the tool's origin from its motion, for every instant [m].
        max_orientation_deviation: Of its orientation from that at the same place [rad].
        orientation: "slerp" about an axis that keeps still, or "free": only the origin is led.
        allow_partial: Whether a motion that ends early is an answer too.
    """

    motions: list[ToolMotion] | None = None
    max_deviation: Positive = 1e-4
    max_orientation_deviation: Positive = 1e-3
    orientation: Literal["slerp", "free"] = "slerp"
    allow_partial: bool = False

    def as_options(self) -> dict[str, Any]:
        """The mapping that a plan's `planner_options` take."""
        return self.model_dump(mode="json", exclude_none=True)


class ToolMotionReport(Answer):
    """What became of one motion of the tool.

    Args:
        type: "lin" or "circ".
        length: Of the whole of it [m].
        angle: How far the tool turns in the whole of it [rad].
        fraction: How far it was carried out.
        begins: When [s].
        ends: When [s].
    """

    type: str
    length: float
    angle: float
    fraction: float
    begins: float
    ends: float


Objective = Literal["time", "jerk", "energy", "path_length"]


class Refine(Request):
    """How the motion that was found is optimised, before it is proved.

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
    """What can be asked of a plan beyond robot, start and goal.

    Args:
        scene: What is in the way: a stored scene's name, or a scene.
        planner: "auto" if left out.
        planner_options: The planner's own.
        refine: Whether, or how, the motion that was found is optimised.
        constraints: That hold along the path.
        attached: Objects that move with a link.
        allowed_collisions: More pairs that may touch.
        margin: Distance to be kept [m].
        start_state_tolerance: A start so little outside a limit is moved onto it [rad or m].
        timing: How the path becomes a motion.
        limits: Of the joints, in place of the robot's.
        timeout: For all stages together [s].
        seed: Of the random generators.
    """

    scene: SceneReference
    planner: str
    planner_options: Options
    refine: bool | Refine
    constraints: Constraints
    attached: AttachedObjects
    allowed_collisions: Pairs
    margin: float
    start_state_tolerance: float
    timing: Timing
    limits: LimitValues
    timeout: float
    seed: int


class PlanRequest(Request):
    """A motion to be planned; see `PlanOptions`."""

    robot: str
    start: Start
    goal: Goal
    scene: SceneReference | None = None
    planner: str = "auto"
    planner_options: Options | None = None
    refine: bool | Refine | None = None
    constraints: Constraints | None = None
    attached: AttachedObjects | None = None
    allowed_collisions: Pairs | None = None
    margin: NonNegative | None = None
    start_state_tolerance: NonNegative | None = None
    timing: Timing | None = None
    limits: LimitValues | None = None
    timeout: Positive | None = None
    seed: int = 0


class Stage(Answer):
    """What one stage of planning did, and how long it took [ms]."""

    name: str
    outcome: str
    milliseconds: float
    detail: str | None = None


class Path(Answer):
    """The corners of a path in joint space, and its length there."""

    joints: list[list[float]]
    length: float


class Reproducibility(Answer):
    """What the same answer can be had again with."""

    seed: int
    robot_hash: str
    scene_hash: str
    request_hash: str
    versions: dict[str, str]


class Descent(Answer):
    """Where a potential field went before its path was shortened.

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


class Plan(Answer):
    """A certified motion.

    Args:
        status: "success".
        planner: The stage that found it.
        stages: What each stage did, in order.
        path: Its corners.
        trajectory: The timed motion.
        certificate: The proof that it is valid at every instant.
        reproducibility: What the same answer can be had again with.
        fraction: How much of the motions of the planner "cartesian" was carried out.
        tool_motions: What became of each.
        stopped: Why they end early, where they do.
        notes: What was done to the request, say a start moved onto a limit.
        potential_field: Where it went, if a potential field found the path.
        progress: The shortest paths over time, of planners that improve theirs.
    """

    status: str
    planner: str
    stages: list[Stage]
    path: Path
    trajectory: TimedTrajectory
    certificate: Certificate
    reproducibility: Reproducibility
    fraction: float | None = None
    tool_motions: list[ToolMotionReport] | None = None
    stopped: dict[str, Any] | None = None
    notes: list[str] = Field(default_factory=list)
    potential_field: Descent | None = None
    progress: list[Progress] = Field(default_factory=list)


class RetimePath(Request):
    """Points in joint space, with the times of a spline if there are any [s]."""

    joints: Rows
    knots: Vector | None = None
    joint_names: list[str] | None = None


class RetimeTiming(Timing):
    """How given points become a motion in time.

    Args:
        start_velocity: At the start, along the path; at rest if left out.
        end_velocity: At the end, likewise.
    """

    start_velocity: Vector | None = None
    end_velocity: Vector | None = None


class RetimeRequest(Request):
    """A path to be timed, within a robot's limits or those given."""

    path: RetimePath
    robot: str | None = None
    limits: LimitValues | None = None
    timing: RetimeTiming | None = None
    timeout: Positive | None = None


class Retimed(Answer):
    """A timed motion, and what was proved of its limits.

    Args:
        status: "success".
        trajectory: The motion.
        certificate: Of its limits alone; not verified where times that were given break them.
        factor: Times that were given were stretched by this.
        needed_factor: Times have to be stretched by this for all limits to hold; 1 if they do.
        notes: What is special about the path.
    """

    status: str
    trajectory: TimedTrajectory
    certificate: Certificate
    factor: float
    needed_factor: float
    notes: list[str] = Field(default_factory=list)


class BatchProblem(Request):
    """One of many problems; what is left out is taken from the batch, see `PlanOptions`."""

    robot: str | None = None
    start: Start | None = None
    goal: Goal | None = None
    scene: SceneReference | None = None
    planner: str | None = None
    planner_options: Options | None = None
    constraints: Constraints | None = None
    attached: AttachedObjects | None = None
    allowed_collisions: Pairs | None = None
    margin: NonNegative | None = None
    start_state_tolerance: NonNegative | None = None
    timing: Timing | None = None
    limits: LimitValues | None = None
    timeout: Positive | None = None
    seed: int | None = None

    @classmethod
    def towards(cls, goal: "GoalLike", **given: Any) -> Self:
        """The way to a goal; `given` are other fields."""
        return cls.of(goal=as_goal(goal), **given)


class BatchRequest(BatchProblem):
    """Many problems, to be answered in order."""

    problems: list[PlanRequest | BatchProblem]


class BatchAnswer(Answer):
    """What became of each problem, in order.

    Args:
        results: A plan, or the problem document that says why there is none.
        succeeded: How many plans there are.
        failed: How many there are not.
    """

    results: list[Annotated[Plan | Problem, Field(union_mode="left_to_right")]]
    succeeded: int
    failed: int
