"""The interface of the service: each request is made here and nowhere else."""

from collections.abc import Mapping, Sequence
from typing import Unpack

from armwright_client.base import Options, RowsLike, VectorLike
from armwright_client.call import (
    Call,
    Endpoint,
    EventCall,
    EventEndpoint,
    JobEndpoint,
    nothing,
    path,
)
from armwright_client.certificate import (
    Certificate,
    LimitValues,
    ValidateOptions,
    ValidateRequest,
)
from armwright_client.check import CheckAnswer, CheckBatch, CheckOptions, CheckRequest
from armwright_client.dynamics import (
    DynamicsAnswer,
    DynamicsBatch,
    DynamicsRequest,
    ModelOptions,
    RegressorAnswer,
    RegressorOptions,
    RegressorRequest,
    VelocityAnswer,
    VelocityOptions,
    VelocityRequest,
    WrenchAnswer,
    WrenchBatch,
    WrenchOptions,
    WrenchRequest,
)
from armwright_client.health import Health, Readiness
from armwright_client.job import Job, JobList
from armwright_client.kinematics import (
    FkAnswer,
    FkBatch,
    FkRequest,
    IkAnswer,
    IkBatch,
    IkOptions,
    IkRequest,
    JacobianAnswer,
    JacobianBatch,
    JacobianOptions,
    JacobianRequest,
    Orientation,
)
from armwright_client.pending import cancel_call, events_call, job_call
from armwright_client.plan import (
    BatchAnswer,
    BatchProblem,
    BatchRequest,
    GoalLike,
    Plan,
    PlanOptions,
    PlanRequest,
    Retimed,
    RetimePath,
    RetimeRequest,
    RetimeTiming,
    Start,
    as_goal,
)
from armwright_client.pose import Pose
from armwright_client.potential import (
    PotentialAnswer,
    PotentialBatch,
    PotentialOptions,
    PotentialRequest,
)
from armwright_client.robot import Robot, RobotArchive, RobotList, RobotUpload
from armwright_client.scene import (
    ProjectAnswer,
    ProjectRequest,
    Scene,
    SceneList,
    SceneReference,
    SceneSummary,
)
from armwright_client.simulation import SimulateOptions, SimulateRequest, Simulation
from armwright_client.trajectory import Trajectory

#: Meshes of a robot are taken apart into convex pieces when it is stored, which takes its time [s].
_BUILDING = 300.0


def _page(after: str | None, limit: int | None) -> Mapping[str, str | int]:
    query = {"after": after, "limit": limit}
    return {name: value for name, value in query.items() if value is not None}


class RobotEndpoints:
    """Robots: stored models, and what is computed of one of them."""

    @Endpoint
    def create(
        self, robot: RobotUpload | RobotArchive, *, idempotency_key: str | None = None
    ) -> Call[Robot]:
        """Store a robot under a name that is free, and give the model made of it."""
        return Call(
            "POST",
            path("robots"),
            Robot.read,
            robot,
            key=idempotency_key,
            deadline=_BUILDING,
            repeatable=False,
        )

    @Endpoint
    def get(self, name: str) -> Call[Robot]:
        """The model of a robot."""
        return Call("GET", path("robots", name), Robot.read)

    @Endpoint
    def delete(self, name: str) -> Call[None]:
        """Forget a robot; built-in ones stay."""
        return Call("DELETE", path("robots", name), nothing)

    @Endpoint
    def fk(
        self,
        robot: str,
        joints: VectorLike,
        *,
        link: str | None = None,
        orientation: Orientation | None = None,
    ) -> Call[FkAnswer]:
        """Poses of the links at a configuration [rad or m]."""
        body = FkRequest.of(joints=joints, link=link, orientation=orientation)
        return Call("POST", path("robots", robot, "fk"), FkAnswer.read, body)

    @Endpoint
    def fk_batch(
        self,
        robot: str,
        joints: RowsLike,
        *,
        link: str | None = None,
        orientation: Orientation | None = None,
    ) -> Call[FkBatch]:
        """Poses of the links at many configurations."""
        body = FkRequest.of(joints=joints, link=link, orientation=orientation)
        return Call("POST", path("robots", robot, "fk"), FkBatch.read, body)

    @Endpoint
    def jacobian(
        self, robot: str, joints: VectorLike, **options: Unpack[JacobianOptions]
    ) -> Call[JacobianAnswer]:
        """The Jacobian at a configuration; see `JacobianOptions`."""
        body = JacobianRequest.of(joints=joints, **options)
        return Call("POST", path("robots", robot, "jacobian"), JacobianAnswer.read, body)

    @Endpoint
    def jacobian_batch(
        self, robot: str, joints: RowsLike, **options: Unpack[JacobianOptions]
    ) -> Call[JacobianBatch]:
        """Jacobians at many configurations; see `JacobianOptions`."""
        body = JacobianRequest.of(joints=joints, **options)
        return Call("POST", path("robots", robot, "jacobian"), JacobianBatch.read, body)

    @Endpoint
    def ik(
        self, robot: str, pose: Pose | None = None, **options: Unpack[IkOptions]
    ) -> Call[IkAnswer]:
        """Configurations that reach a pose or hold constraints, best first; see `IkOptions`."""
        body = IkRequest.of(pose=pose, **options)
        return Call("POST", path("robots", robot, "ik"), IkAnswer.read, body, deadline=body.timeout)

    @Endpoint
    def ik_batch(
        self, robot: str, poses: Sequence[Pose], **options: Unpack[IkOptions]
    ) -> Call[IkBatch]:
        """Configurations that reach each of many poses; see `IkOptions`."""
        body = IkRequest.of(poses=list(poses), **options)
        return Call("POST", path("robots", robot, "ik"), IkBatch.read, body, deadline=body.timeout)

    @Endpoint
    def velocity(
        self, robot: str, joints: VectorLike, **options: Unpack[VelocityOptions]
    ) -> Call[VelocityAnswer]:
        """The twist of joint velocities, or the least joint velocities for a twist.

        See `VelocityOptions`.
        """
        body = VelocityRequest.of(joints=joints, **options)
        return Call("POST", path("robots", robot, "velocity"), VelocityAnswer.read, body)

    @Endpoint
    def wrench(
        self,
        robot: str,
        joints: VectorLike,
        wrench: VectorLike,
        **options: Unpack[WrenchOptions],
    ) -> Call[WrenchAnswer]:
        """Joint torques that balance a wrench [f; n] at the tip: τ = Jᵀ F; see `WrenchOptions`."""
        body = WrenchRequest.of(joints=joints, wrench=wrench, **options)
        return Call("POST", path("robots", robot, "wrench"), WrenchAnswer.read, body)

    @Endpoint
    def wrench_batch(
        self,
        robot: str,
        joints: RowsLike,
        wrench: VectorLike,
        **options: Unpack[WrenchOptions],
    ) -> Call[WrenchBatch]:
        """Joint torques that balance a wrench at many configurations; see `WrenchOptions`."""
        body = WrenchRequest.of(joints=joints, wrench=wrench, **options)
        return Call("POST", path("robots", robot, "wrench"), WrenchBatch.read, body)

    @Endpoint
    def dynamics(
        self,
        robot: str,
        joints: VectorLike,
        *,
        velocities: VectorLike | None = None,
        accelerations: VectorLike | None = None,
        wrench: VectorLike | None = None,
        **options: Unpack[ModelOptions],
    ) -> Call[DynamicsAnswer]:
        """The equations of motion at a configuration; see `ModelOptions`."""
        body = DynamicsRequest.of(
            joints=joints,
            velocities=velocities,
            accelerations=accelerations,
            wrench=wrench,
            **options,
        )
        return Call("POST", path("robots", robot, "dynamics"), DynamicsAnswer.read, body)

    @Endpoint
    def dynamics_batch(
        self,
        robot: str,
        joints: RowsLike,
        *,
        velocities: RowsLike | None = None,
        accelerations: RowsLike | None = None,
        wrench: VectorLike | None = None,
        **options: Unpack[ModelOptions],
    ) -> Call[DynamicsBatch]:
        """The equations of motion at many configurations; see `ModelOptions`."""
        body = DynamicsRequest.of(
            joints=joints,
            velocities=velocities,
            accelerations=accelerations,
            wrench=wrench,
            **options,
        )
        return Call("POST", path("robots", robot, "dynamics"), DynamicsBatch.read, body)

    @Endpoint
    def potential(
        self,
        robot: str,
        joints: VectorLike,
        goal_joints: VectorLike,
        scene: SceneReference | None = None,
        *,
        options: PotentialOptions | None = None,
        timeout: float | None = None,
    ) -> Call[PotentialAnswer]:
        """The potential field at a configuration on the way to a goal."""
        body = PotentialRequest.of(
            joints=joints, goal_joints=goal_joints, scene=scene, options=options, timeout=timeout
        )
        return Call(
            "POST", path("robots", robot, "potential"), PotentialAnswer.read, body, deadline=timeout
        )

    @Endpoint
    def potential_batch(
        self,
        robot: str,
        joints: RowsLike,
        goal_joints: VectorLike,
        scene: SceneReference | None = None,
        *,
        options: PotentialOptions | None = None,
        timeout: float | None = None,
    ) -> Call[PotentialBatch]:
        """The potential field at many configurations."""
        body = PotentialRequest.of(
            joints=joints, goal_joints=goal_joints, scene=scene, options=options, timeout=timeout
        )
        return Call(
            "POST", path("robots", robot, "potential"), PotentialBatch.read, body, deadline=timeout
        )

    @Endpoint
    def regressor(
        self,
        robot: str,
        joints: VectorLike,
        velocities: VectorLike,
        accelerations: VectorLike,
        **options: Unpack[RegressorOptions],
    ) -> Call[RegressorAnswer]:
        """The equations of motion as linear in the links' parameters; see `RegressorOptions`."""
        body = RegressorRequest.of(
            joints=joints, velocities=velocities, accelerations=accelerations, **options
        )
        return Call("POST", path("robots", robot, "regressor"), RegressorAnswer.read, body)

    # Last, since it hides the built-in type from what follows.
    @Endpoint
    def list(self, *, after: str | None = None, limit: int | None = None) -> Call[RobotList]:
        """A page of the robots, built-in ones among them, by name."""
        return Call("GET", path("robots"), RobotList.read, query=_page(after, limit))


class SceneEndpoints:
    """Scenes: stored obstacles, and projections onto them."""

    @Endpoint
    def create(self, scene: Scene, *, idempotency_key: str | None = None) -> Call[SceneSummary]:
        """Store a scene under its name, which must be free."""
        return Call(
            "POST",
            path("scenes"),
            SceneSummary.read,
            scene,
            key=idempotency_key,
            repeatable=False,
        )

    @Endpoint
    def get(self, name: str) -> Call[Scene]:
        """A scene as it was stored."""
        return Call("GET", path("scenes", name), Scene.read)

    @Endpoint
    def replace(self, name: str, scene: Scene) -> Call[SceneSummary]:
        """Store a scene under a name, whether there is one or not."""
        body = scene.model_copy(update={"name": None})
        return Call("PUT", path("scenes", name), SceneSummary.read, body)

    @Endpoint
    def delete(self, name: str) -> Call[None]:
        """Forget a scene."""
        return Call("DELETE", path("scenes", name), nothing)

    @Endpoint
    def project(self, name: str, points: RowsLike) -> Call[ProjectAnswer]:
        """The nearest point of every obstacle to each of the points [m]."""
        body = ProjectRequest.of(points=points)
        return Call("POST", path("scenes", name, "project"), ProjectAnswer.read, body)

    # Last, since it hides the built-in type from what follows.
    @Endpoint
    def list(self, *, after: str | None = None, limit: int | None = None) -> Call[SceneList]:
        """A page of the stored scenes, by name."""
        return Call("GET", path("scenes"), SceneList.read, query=_page(after, limit))


class JobEndpoints:
    """Jobs: work that goes on after it was accepted."""

    @Endpoint
    def get(self, job: str) -> Call[Job]:
        """Where a job stands."""
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
        query = dict(_page(after, limit)) | ({} if status is None else {"status": status})
        return Call("GET", path("jobs"), JobList.read, query=query)


class ServiceEndpoints:
    """What is asked of the service as a whole."""

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
    ) -> Call[Plan]:
        """A certified motion from a configuration to a goal; see `PlanOptions`."""
        begin = start if isinstance(start, Start) else Start.of(joints=start)
        body = PlanRequest.of(robot=robot, start=begin, goal=as_goal(goal), **options)
        return Call("POST", path("plan"), Plan.read, body, deadline=body.timeout)

    @JobEndpoint
    def plan_batch(
        self,
        problems: Sequence[PlanRequest | BatchProblem],
        *,
        robot: str | None = None,
        start: VectorLike | None = None,
        idempotency_key: str | None = None,
        **options: Unpack[PlanOptions],
    ) -> Call[BatchAnswer]:
        """Have many problems planned, as a job; what is given here holds for all that lack it."""
        begin = None if start is None else Start.of(joints=start)
        body = BatchRequest.of(problems=[*problems], robot=robot, start=begin, **options)
        return Call(
            "POST",
            path("plan", "batch"),
            BatchAnswer.read,
            body,
            key=idempotency_key,
            repeatable=False,
        )

    @Endpoint
    def validate(
        self, robot: str, trajectory: Trajectory, **options: Unpack[ValidateOptions]
    ) -> Call[Certificate]:
        """The proof that a motion is valid, or its first violation; see `ValidateOptions`."""
        body = ValidateRequest.of(robot=robot, trajectory=trajectory, **options)
        return Call("POST", path("validate"), Certificate.read, body, deadline=body.timeout)

    @Endpoint
    def retime(
        self,
        joints: RowsLike,
        *,
        knots: VectorLike | None = None,
        robot: str | None = None,
        limits: LimitValues | None = None,
        timing: RetimeTiming | None = None,
        timeout: float | None = None,
    ) -> Call[Retimed]:
        """Time a path within the limits of a robot, or within those given."""
        body = RetimeRequest.of(
            path=RetimePath.of(joints=joints, knots=knots),
            robot=robot,
            limits=limits,
            timing=timing,
            timeout=timeout,
        )
        return Call("POST", path("retime"), Retimed.read, body, deadline=timeout)

    @Endpoint
    def simulate(
        self,
        robot: str,
        trajectory: Trajectory,
        controller: Options,
        **options: Unpack[SimulateOptions],
    ) -> Call[Simulation]:
        """Follow a motion with a controller, its type and gains given; see `SimulateOptions`."""
        body = SimulateRequest.of(
            robot=robot, trajectory=trajectory, controller=controller, **options
        )
        return Call("POST", path("simulate"), Simulation.read, body, deadline=body.timeout)
