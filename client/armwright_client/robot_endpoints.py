"""Requests about one robot: its model and what is computed of it."""

from collections.abc import Mapping, Sequence
from typing import Unpack

from armwright_client.base import RowsLike, VectorLike
from armwright_client.call import (
    Call,
    Endpoint,
    nothing,
    path,
)
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
from armwright_client.pose import Pose
from armwright_client.potential import (
    PotentialAnswer,
    PotentialBatch,
    PotentialOptions,
    PotentialRequest,
)
from armwright_client.robot import Robot, RobotArchive, RobotList, RobotUpload
from armwright_client.scene import (
    Engine,
    SceneReference,
)

#: Meshes of a robot are taken apart into convex pieces when it is stored, which takes its time [s].
_BUILDING = 300.0


def page(after: str | None, limit: int | None) -> Mapping[str, str | int]:
    """Query parameters of one page of a list."""
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
        engine: Engine = "exact",
        timeout: float | None = None,
    ) -> Call[PotentialAnswer]:
        """The potential field at a configuration on the way to a goal."""
        body = PotentialRequest.of(
            joints=joints,
            goal_joints=goal_joints,
            scene=scene,
            options=options,
            engine=engine,
            timeout=timeout,
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
        engine: Engine = "exact",
        timeout: float | None = None,
    ) -> Call[PotentialBatch]:
        """The potential field at many configurations."""
        body = PotentialRequest.of(
            joints=joints,
            goal_joints=goal_joints,
            scene=scene,
            options=options,
            engine=engine,
            timeout=timeout,
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
        return Call("GET", path("robots"), RobotList.read, query=page(after, limit))
