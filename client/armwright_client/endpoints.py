"""The interface of the service: each request is made here and nowhere else."""

from collections.abc import Sequence
from typing import Literal, Unpack

from armwright_client.answers import CheckAnswer, CheckBatch, Health, Readiness
from armwright_client.call import (
    Call,
    Endpoint,
    EventCall,
    EventEndpoint,
    JobEndpoint,
    cancel_call,
    create_call,
    events_call,
    job_call,
    path,
    read_nothing,
    replace_call,
)
from armwright_client.job import Job, JobList
from armwright_client.options.plan_options import (
    CheckOptions,
    ExportOptions,
    GuardOptions,
    LyapunovOptions,
    Options,
    PlanOptions,
    ProgramOptions,
    RetimeOptions,
    SimulateOptions,
    TaskOptions,
    TourOptions,
    ValidateOptions,
)
from armwright_client.robot_endpoints import page
from armwright_wire.base import RowsLike, VectorLike
from armwright_wire.goals.goal import GoalLike, Start, as_goal
from armwright_wire.motions.certificate import CertificateAnswer
from armwright_wire.motions.export import ExportAnswer, ExportRequest, KeptMotion
from armwright_wire.motions.export import Format as ExportFormat
from armwright_wire.motions.retime import (
    FitAnswer,
    FitRequest,
    JointStateBody,
    LimitsAt,
    PathBody,
    RetimeAnswer,
    RetimePath,
    RetimeRequest,
    RetimeTiming,
    SimplifyAnswer,
    SimplifyRequest,
    TipTolerance,
)
from armwright_wire.motions.simulation import SimulateAnswer, SimulateRequest
from armwright_wire.motions.trajectory import LimitsBody, Samples, TrajectoryAnswer, TrajectoryBody
from armwright_wire.plans.batch import BatchAnswer, BatchRequest, PartialPlan, as_part
from armwright_wire.plans.guard import GuardAnswer, GuardRequest, GuardState, Proposal
from armwright_wire.plans.kept_plan import (
    Bundle,
    KeptPlan,
    KeptPlanSummary,
    PlanList,
    ReplayAnswer,
    ReplayRequest,
    StopAnswer,
    StopRequest,
)
from armwright_wire.plans.plan import PlanAnswer, PlanRequest, ValidateRequest
from armwright_wire.plans.stages import StageUnion
from armwright_wire.plans.task import TaskAnswer, TaskRequest
from armwright_wire.plans.tour import TourAnswer, TourGoal, TourRequest, as_tour_goal
from armwright_wire.pose import ConvertPoseAnswer, ConvertPoseRequest, Motion, PoseForm
from armwright_wire.robots.lyapunov import LyapunovAnswer, LyapunovRequest
from armwright_wire.scenes.check import CheckRequest
from armwright_wire.scenes.scene import (
    Engine,
    ProjectAnswer,
    ProjectRequest,
    Scene,
    SceneList,
    SceneSummary,
)
from armwright_wire.scenes.tool import NamedTool, Tool, ToolList, ToolSummary


class SceneEndpoints:
    """Scenes: stored obstacles, and projections onto them."""

    @Endpoint
    def create(self, scene: Scene, *, idempotency_key: str | None = None) -> Call[SceneSummary]:
        """Store a scene under its name, which must be free."""
        return create_call(path("scenes"), SceneSummary.read, scene, idempotency_key)

    @Endpoint
    def get(self, name: str) -> Call[Scene]:
        """A scene as it was stored."""
        return Call("GET", path("scenes", name), Scene.read)

    @Endpoint
    def replace(self, name: str, scene: Scene) -> Call[SceneSummary]:
        """Store a scene under a name, whether there is one or not."""
        return replace_call(path("scenes", name), SceneSummary.read, scene)

    @Endpoint
    def delete(self, name: str) -> Call[None]:
        """Forget a scene."""
        return Call("DELETE", path("scenes", name), read_nothing)

    @Endpoint
    def project(
        self, name: str, points: RowsLike, *, engine: Engine = "exact"
    ) -> Call[ProjectAnswer]:
        """The nearest point of every obstacle to each of the points [m], exact or by FCL."""
        body = ProjectRequest.of(points=points, engine=engine)
        return Call("POST", path("scenes", name, "project"), ProjectAnswer.read, body)

    # Last, since it hides the built-in type from what follows.
    @Endpoint
    def list(self, *, after: str | None = None, limit: int | None = None) -> Call[SceneList]:
        """A page of the stored scenes, by name."""
        return Call("GET", path("scenes"), SceneList.read, query=page(after, limit))


class ToolEndpoints:
    """Tools: what robots work with, mounted by the options `tool` and `tcp`."""

    @Endpoint
    def create(self, tool: Tool, *, idempotency_key: str | None = None) -> Call[ToolSummary]:
        """Store a tool under its name, which must be free."""
        return create_call(path("tools"), ToolSummary.read, tool, idempotency_key)

    @Endpoint
    def get(self, name: str) -> Call[NamedTool]:
        """A tool as it was stored, or a built-in one."""
        return Call("GET", path("tools", name), NamedTool.read)

    @Endpoint
    def replace(self, name: str, tool: Tool) -> Call[ToolSummary]:
        """Store a tool under a name, whether there is one or not."""
        return replace_call(path("tools", name), ToolSummary.read, tool)

    @Endpoint
    def delete(self, name: str) -> Call[None]:
        """Forget a tool."""
        return Call("DELETE", path("tools", name), read_nothing)

    # Last, since it hides the built-in type from what follows.
    @Endpoint
    def list(self, *, after: str | None = None, limit: int | None = None) -> Call[ToolList]:
        """A page of the built-in and stored tools, by name."""
        return Call("GET", path("tools"), ToolList.read, query=page(after, limit))


class JobEndpoints:
    """Jobs: work that goes on after it was accepted."""

    @Endpoint
    def get(self, job: str) -> Call[Job]:
        """Status of a job."""
        return job_call(job)

    @Endpoint
    def cancel(self, job: str) -> Call[Job]:
        """End a job that waits or runs; raises `Conflict` if it has succeeded or failed."""
        return cancel_call(job)

    @EventEndpoint
    def events(self, job: str, *, after: str | None = None) -> EventCall:
        """The events of a job until it ends, from the beginning or after the `id` of one."""
        return events_call(job, after)

    # Last, since it hides the built-in type from what follows.
    @Endpoint
    def list(
        self, *, status: str | None = None, after: str | None = None, limit: int | None = None
    ) -> Call[JobList]:
        """A page of the jobs, newest first, perhaps only those of a status."""
        query = dict(page(after, limit)) | ({} if status is None else {"status": status})
        return Call("GET", path("jobs"), JobList.read, query=query)


class PlanEndpoints:
    """Kept plans: what was asked with `keep`, with its answer or problem."""

    @Endpoint
    def get(self, plan: str) -> Call[KeptPlan]:
        """A kept plan with its request and its answer or problem."""
        return Call("GET", path("plans", plan), KeptPlan.read)

    @Endpoint
    def delete(self, plan: str) -> Call[None]:
        """Forget a kept plan."""
        return Call("DELETE", path("plans", plan), read_nothing)

    @Endpoint
    def replay(
        self,
        plan: str,
        changes: Options | None = None,
        *,
        documents: Literal["kept", "current"] = "kept",
        keep_replay: bool | None = None,
    ) -> Call[ReplayAnswer]:
        """Compute a kept plan again, perhaps with changes; see `ReplayRequest`."""
        body = ReplayRequest.of(changes=changes, documents=documents, keep_replay=keep_replay)
        return Call("POST", path("plans", plan, "replay"), ReplayAnswer.read, body)

    @Endpoint
    def bundle(self, plan: str) -> Call[Bundle]:
        """A kept plan as a file, with its robot and scene; `import_bundle` takes it."""
        return Call("GET", path("plans", plan, "bundle"), Bundle.read)

    @Endpoint
    def import_bundle(self, bundle: Bundle) -> Call[KeptPlanSummary]:
        """Keep the plan of a bundle of another installation."""
        return create_call(path("plans"), KeptPlanSummary.read, bundle)

    @Endpoint
    def view(self, plan: str, *, tree: bool = False) -> Call[bytes]:
        """One HTML file that shows it; with the tree of its last planner, planned once more."""
        query: dict[str, str] = {"tree": "true"} if tree else {}
        return Call("GET", path("plans", plan, "view"), bytes, query=query)

    @Endpoint
    def swept(
        self,
        plan: str,
        *,
        format: Literal["glb", "stl"] = "glb",  # noqa: A002  (its name in the API)
        tolerance: float = 0.005,
    ) -> Call[bytes]:
        """A mesh of the space that a kept motion takes up; hulls may grow by the tolerance [m]."""
        query: dict[str, str | float] = {"format": format, "tolerance": tolerance}
        return Call("GET", path("plans", plan, "swept"), bytes, query=query)

    @Endpoint
    def stop(
        self,
        plan: str,
        at: float,
        *,
        kind: Literal["path", "joints"] = "path",
        timeout: float | None = None,
    ) -> Call[StopAnswer]:
        """The stop of a kept motion from an instant on [s], with its certificate."""
        body = StopRequest.of(at=at, kind=kind, timeout=timeout)
        return Call("POST", path("plans", plan, "stop"), StopAnswer.read, body, deadline=timeout)

    @Endpoint
    def witness(self, plan: str, *, part: int = 0) -> Call[bytes]:
        """The file from which anybody can check a kept plan or proof without the service.

        Of a task or a tour it is that of one stage or leg.
        """
        query: dict[str, str | int] = {"form": "compact", "part": part}
        return Call("GET", path("plans", plan, "witness"), bytes, query=query)

    # Last, since it hides the built-in type from what follows.
    @Endpoint
    def list(
        self, *, robot: str | None = None, after: str | None = None, limit: int | None = None
    ) -> Call[PlanList]:
        """A page of the kept plans, newest first, perhaps only those of a robot."""
        query = dict(page(after, limit)) | ({} if robot is None else {"robot": robot})
        return Call("GET", path("plans"), PlanList.read, query=query)


class ServiceEndpoints:
    """Requests to the service as a whole."""

    @Endpoint
    def healthz(self) -> Call[Health]:
        """Whether the service answers."""
        return Call("GET", "/healthz", Health.read)

    @Endpoint
    def readyz(self) -> Call[Readiness]:
        """Whether work can be sent; raises `NotReady`, at once, where it can't yet."""
        return Call("GET", "/readyz", Readiness.read, repeatable=False)

    @Endpoint
    def check(
        self, robot: str, joints: VectorLike, **options: Unpack[CheckOptions]
    ) -> Call[CheckAnswer]:
        """Whether a configuration is inside its limits and free; see `CheckOptions`."""
        body = CheckRequest.of(robot=robot, joints=joints, **options)
        return Call("POST", path("check"), CheckAnswer.read, body, deadline=body.timeout)

    @Endpoint
    def check_batch(
        self, robot: str, joints: RowsLike, **options: Unpack[CheckOptions]
    ) -> Call[CheckBatch]:
        """Whether each of many configurations is; see `CheckOptions`."""
        body = CheckRequest.of(robot=robot, joints=joints, **options)
        return Call("POST", path("check"), CheckBatch.read, body, deadline=body.timeout)

    @Endpoint
    def plan(
        self,
        robot: str,
        start: VectorLike | Start,
        goal: GoalLike,
        **options: Unpack[PlanOptions],
    ) -> Call[PlanAnswer]:
        """A certified motion from a configuration to a goal; see `PlanOptions`."""
        begin = start if isinstance(start, Start) else Start.of(joints=start)
        body = PlanRequest.of(robot=robot, start=begin, goal=as_goal(goal), **options)
        return Call("POST", path("plan"), PlanAnswer.read, body, deadline=body.timeout)

    @JobEndpoint
    def plan_batch(
        self,
        problems: Sequence[PlanRequest | PartialPlan],
        *,
        robot: str | None = None,
        start: VectorLike | None = None,
        idempotency_key: str | None = None,
        **options: Unpack[PlanOptions],
    ) -> Call[BatchAnswer]:
        """Have many problems planned, as a job; what is given here holds for all that lack it."""
        begin = None if start is None else Start.of(joints=start)
        body = BatchRequest.of(
            problems=[as_part(one) for one in problems], robot=robot, start=begin, **options
        )
        return create_call(path("plan", "batch"), BatchAnswer.read, body, idempotency_key)

    @Endpoint
    def plan_task(
        self,
        robot: str,
        start: VectorLike | Start,
        stages: Sequence[StageUnion],
        **options: Unpack[TaskOptions],
    ) -> Call[TaskAnswer]:
        """The motions of all stages of a task, each certified; see `TaskOptions`."""
        begin = start if isinstance(start, Start) else Start.of(joints=start)
        body = TaskRequest.of(robot=robot, start=begin, stages=[*stages], **options)
        return Call("POST", path("tasks"), TaskAnswer.read, body, deadline=body.timeout)

    @Endpoint
    def plan_tour(
        self, robot: str, goals: Sequence[TourGoal | GoalLike], **options: Unpack[TourOptions]
    ) -> Call[TourAnswer]:
        """Many goals in the order that takes the least time, legs certified; see `TourOptions`."""
        stops = [g if isinstance(g, TourGoal) else as_tour_goal(g) for g in goals]
        body = TourRequest.of(robot=robot, goals=stops, **options)
        return Call("POST", path("tours"), TourAnswer.read, body, deadline=body.timeout)

    @Endpoint
    def validate(
        self,
        robot: str,
        trajectory: TrajectoryBody | TrajectoryAnswer,
        **options: Unpack[ValidateOptions],
    ) -> Call[CertificateAnswer]:
        """The proof that a motion is valid, or its first violation; see `ValidateOptions`."""
        body = ValidateRequest.of(robot=robot, trajectory=trajectory, **options)
        return Call("POST", path("validate"), CertificateAnswer.read, body, deadline=body.timeout)

    @Endpoint
    def guard(
        self,
        robot: str,
        positions: VectorLike | GuardState,
        proposal: Proposal,
        latency: float = 0.0,
        **options: Unpack[GuardOptions],
    ) -> Call[GuardAnswer]:
        """How much of a proposal is proved, with the stop behind it; `Guard` is for many."""
        given = isinstance(positions, GuardState)
        state = positions if given else GuardState.of(positions=positions)
        body = GuardRequest.of(
            robot=robot, state=state, proposal=proposal, latency=latency, **options
        )
        return Call("POST", path("guard"), GuardAnswer.read, body, deadline=body.timeout)

    @Endpoint
    def export(
        self,
        robot: str,
        trajectory: TrajectoryBody | TrajectoryAnswer,
        file_format: ExportFormat,
        **options: Unpack[ExportOptions],
    ) -> Call[ExportAnswer]:
        """A motion as a file for a controller, proved as the controller interpolates it."""
        body = ExportRequest.of(robot=robot, trajectory=trajectory, format=file_format, **options)
        return Call("POST", path("export"), ExportAnswer.read, body, deadline=body.timeout)

    @Endpoint
    def export_plan(
        self,
        plan: str | KeptMotion,
        file_format: ExportFormat,
        **options: Unpack[ProgramOptions],
    ) -> Call[ExportAnswer]:
        """A kept plan, task or tour as one program for a controller, proved as one."""
        body = ExportRequest.of(plan=plan, format=file_format, **options)
        return Call("POST", path("export"), ExportAnswer.read, body, deadline=body.timeout)

    @Endpoint
    def convert_pose(
        self,
        pose: PoseForm | None = None,
        *,
        motions: Sequence[Motion] | None = None,
        inverse: bool = False,
        angular_velocity: VectorLike | None = None,
    ) -> Call[ConvertPoseAnswer]:
        """A pose, or motions carried out in turn, in every form."""
        body = ConvertPoseRequest.of(
            pose=pose, motions=motions, inverse=inverse, angular_velocity=angular_velocity
        )
        return Call("POST", path("poses", "convert"), ConvertPoseAnswer.read, body)

    @Endpoint
    def retime(
        self,
        joints: RowsLike,
        *,
        knots: VectorLike | None = None,
        tolerance: float | None = None,
        limits_at: Sequence[LimitsAt] | None = None,
        stops: Literal["none", "path"] | None = None,
        **options: Unpack[RetimeOptions],
    ) -> Call[RetimeAnswer]:
        """Time a path within the limits of a robot, or within those given; see `RetimeOptions`."""
        waypoints = RetimePath.of(joints=joints, knots=knots, tolerance=tolerance)
        body = RetimeRequest.of(path=waypoints, limits_at=limits_at, stops=stops, **options)
        return Call("POST", path("retime"), RetimeAnswer.read, body, deadline=body.timeout)

    @Endpoint
    def simplify(
        self,
        joints: RowsLike,
        tolerance: float | None = None,
        *,
        tool_tolerance: TipTolerance | None = None,
        robot: str | None = None,
        scene: str | Scene | None = None,
        margin: float = 0.0,
        timeout: float | None = None,
    ) -> Call[SimplifyAnswer]:
        """Tell a path by the fewest waypoints within a tolerance, proved where a robot is named."""
        body = SimplifyRequest.of(
            path=PathBody.of(joints=joints),
            tolerance=tolerance,
            tool_tolerance=tool_tolerance,
            robot=robot,
            scene=scene,
            margin=margin,
            timeout=timeout,
        )
        return Call("POST", path("paths", "simplify"), SimplifyAnswer.read, body, deadline=timeout)

    @Endpoint
    def fit(
        self,
        times: VectorLike,
        positions: RowsLike,
        tolerance: float,
        *,
        robot: str | None = None,
        rest: bool = False,
        retime: RetimeTiming | None = None,
        limits: LimitsBody | None = None,
        timeout: float | None = None,
    ) -> Call[FitAnswer]:
        """Few polynomials within a tolerance of a recorded motion, or its geometry timed anew."""
        samples = Samples.of(time=times, position=positions)
        body = FitRequest.of(
            samples=samples,
            tolerance=tolerance,
            robot=robot,
            rest=rest,
            retime=retime,
            limits=limits,
            timeout=timeout,
        )
        return Call("POST", path("paths", "fit"), FitAnswer.read, body, deadline=timeout)

    @Endpoint
    def retime_states(
        self,
        start: JointStateBody,
        end: JointStateBody,
        *,
        joint_names: Sequence[str] | None = None,
        synchronization: str | None = None,
        **options: Unpack[RetimeOptions],
    ) -> Call[RetimeAnswer]:
        """Time the motion between two states with bounded jerk, in the least time."""
        given = {"joint_names": joint_names, "synchronization": synchronization}
        body = RetimeRequest.of(start=start, end=end, **given, **options)
        return Call("POST", path("retime"), RetimeAnswer.read, body, deadline=body.timeout)

    @Endpoint
    def simulate(
        self,
        robot: str,
        trajectory: TrajectoryBody | TrajectoryAnswer | Options,
        controller: Options,
        **options: Unpack[SimulateOptions],
    ) -> Call[SimulateAnswer]:
        """Follow a motion with a controller, its type and gains given; see `SimulateOptions`.

        In place of a trajectory a reference by name will do, for example
        {"type": "sine", "center": [...], "amplitude": 0.3, "frequency": 0.5, "duration": 4}.
        """
        is_named = not isinstance(trajectory, TrajectoryBody | TrajectoryAnswer)
        motion = {"reference" if is_named else "trajectory": trajectory}
        body = SimulateRequest.of(robot=robot, controller=controller, **motion, **options)
        return Call("POST", path("simulate"), SimulateAnswer.read, body, deadline=body.timeout)

    @Endpoint
    def lyapunov(
        self,
        A: RowsLike | None = None,
        P: RowsLike | None = None,
        *,
        Q: RowsLike | None = None,
        x: VectorLike | RowsLike | None = None,
        **options: Unpack[LyapunovOptions],
    ) -> Call[LyapunovAnswer]:
        """V = x'Px as a Lyapunov function of dx/dt = A x; with Q in place of P it is solved for.

        In place of A formulas f and V, or a system by name, are examined; see `LyapunovOptions`.
        """
        body = LyapunovRequest.of(A=A, P=P, Q=Q, x=x, **options)
        return Call("POST", path("lyapunov"), LyapunovAnswer.read, body)
