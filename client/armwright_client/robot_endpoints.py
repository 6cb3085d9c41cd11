"""Requests about one robot: its model and what is computed of it."""

from collections.abc import Callable, Mapping, Sequence
from typing import Literal, TypeVar, Unpack

from armwright_client.answers import (
    DynamicsAnswer,
    DynamicsBatch,
    FkAnswer,
    FkBatch,
    ForwardDynamicsAnswer,
    ForwardDynamicsBatch,
    IkAnswer,
    IkBatch,
    JacobianAnswer,
    JacobianBatch,
    PotentialAnswer,
    PotentialBatch,
    RegressorAnswer,
    VelocityAnswer,
    WrenchAnswer,
    WrenchBatch,
)
from armwright_client.call import Call, Endpoint, create_call, path, read_nothing, read_text
from armwright_client.options.arm_options import (
    CalibrateOptions,
    DynamicsOptions,
    ExcitationOptions,
    FkOptions,
    ForwardDynamicsOptions,
    IdentifyOptions,
    IkOptions,
    JacobianOptions,
    PotentialSettings,
    ReachOptions,
    RegressorOptions,
    VelocityOptions,
    WrenchOptions,
)
from armwright_client.robots.robot import RobotArchive, RobotUpload
from armwright_wire.base import Body, RowsLike, VectorLike
from armwright_wire.motions.excitation import ExcitationAnswer, ExcitationRequest
from armwright_wire.pose import Pose
from armwright_wire.robots.calibration import CalibrateAnswer, CalibrateRequest
from armwright_wire.robots.dynamics import (
    DynamicsRequest,
    EquationsAnswer,
    ForwardDynamicsRequest,
    RegressorRequest,
    WrenchRequest,
)
from armwright_wire.robots.identification import IdentifyAnswer, IdentifyRequest, LogBody
from armwright_wire.robots.kinematics import (
    Axis,
    FkRequest,
    IkRequest,
    JacobianRequest,
    VelocityRequest,
)
from armwright_wire.robots.potential import PotentialRequest
from armwright_wire.robots.reach import ReachAnswer, ReachBox, ReachRequest
from armwright_wire.robots.robot import (
    DefaultLimits,
    GeometryAnswer,
    JointLimits,
    RobotAnswer,
    RobotCalibration,
    RobotChanges,
    RobotInertias,
    RobotList,
)
from armwright_wire.scenes.scene import SceneReference

A = TypeVar("A")

#: Deadline of storing a robot [s]: its meshes are decomposed into convex pieces.
_STORE_TIMEOUT = 300.0


def page(after: str | None, limit: int | None) -> Mapping[str, str | int]:
    """Query parameters of one page of a list."""
    query = {"after": after, "limit": limit}
    return {name: value for name, value in query.items() if value is not None}


def compute(
    robot: str,
    action: str,
    body: Body,
    read: Callable[[bytes], A],
    timeout: float | None = None,
) -> Call[A]:
    """The call that computes something of one robot.

    Args:
        robot: Name of the robot.
        action: Last segment of the path, such as "fk".
        body: Request of what to compute.
        read: Reads the answer's body.
        timeout: Deadline in the service [s]; the service's default if None.
    """
    return Call("POST", path("robots", robot, action), read, body, deadline=timeout)


class RobotEndpoints:
    """Robots: stored models, and what is computed of one of them."""

    @Endpoint
    def create(
        self, robot: RobotUpload | RobotArchive, *, idempotency_key: str | None = None
    ) -> Call[RobotAnswer]:
        """Store a robot under a name that is free, and give the model made of it."""
        return create_call(path("robots"), RobotAnswer.read, robot, idempotency_key, _STORE_TIMEOUT)

    @Endpoint
    def get(self, name: str) -> Call[RobotAnswer]:
        """The model of a robot."""
        return Call("GET", path("robots", name), RobotAnswer.read)

    @Endpoint
    def change(
        self,
        name: str,
        *,
        joint_limits: Mapping[str, JointLimits] | str | None = None,
        default_limits: DefaultLimits | None = None,
        inertias: RobotInertias | None = None,
        calibration: RobotCalibration | str | None = None,
    ) -> Call[RobotAnswer]:
        """Change a stored robot, and give the model made of it; see `RobotChanges`."""
        limits = joint_limits if isinstance(joint_limits, str | None) else dict(joint_limits)
        body = RobotChanges.of(
            joint_limits=limits,
            default_limits=default_limits,
            inertias=inertias,
            calibration=calibration,
        )
        return Call("PATCH", path("robots", name), RobotAnswer.read, body, deadline=_STORE_TIMEOUT)

    @Endpoint
    def urdf(self, name: str, *, merge_limits: bool = False) -> Call[str]:
        """The URDF that a robot came as, or one written of its table; with all known limits."""
        query = {"joint_limits": "merged"} if merge_limits else {}
        return Call("GET", path("robots", name, "urdf"), read_text, query=query)

    @Endpoint
    def srdf(self, name: str) -> Call[str]:
        """An SRDF with the robot's chain, its named states and the pairs that may touch."""
        return Call("GET", path("robots", name, "srdf"), read_text)

    @Endpoint
    def geometry(
        self,
        name: str,
        kind: Literal["collision", "visual"] = "collision",
        *,
        tool: str | None = None,
    ) -> Call[GeometryAnswer]:
        """The geometry of a robot as triangles, in the frames of its links.

        Args:
            name: The robot.
            kind: "visual" for what it looks like, which no proof is about.
            tool: Built-in or stored tool that is mounted, and drawn too.
        """
        query: dict[str, str] = {} if kind == "collision" else {"kind": kind}
        if tool is not None:
            query["tool"] = tool
        return Call("GET", path("robots", name, "geometry"), GeometryAnswer.read, query=query)

    @Endpoint
    def equations(
        self,
        name: str,
        notation: Literal["latex", "text"] = "latex",
        *,
        axes: Sequence[Axis] = (),
        timeout: float | None = None,
    ) -> Call[EquationsAnswer]:
        """Kinematics and dynamics of a robot as formulas, in LaTeX or plain text.

        Args:
            name: The robot.
            notation: How formulas are written.
            axes: Rows of the Jacobian, as many as joints, whose determinant is answered.
            timeout: [s]; the service's default if left out.
        """
        query: dict[str, str | float] = {"format": notation}
        if axes:
            query["axes"] = ",".join(axes)
        if timeout is not None:
            query["timeout"] = timeout
        where = path("robots", name, "equations")
        return Call("GET", where, EquationsAnswer.read, query=query, deadline=timeout)

    @Endpoint
    def delete(self, name: str) -> Call[None]:
        """Forget a robot; built-in ones stay."""
        return Call("DELETE", path("robots", name), read_nothing)

    @Endpoint
    def fk(self, robot: str, joints: VectorLike, **options: Unpack[FkOptions]) -> Call[FkAnswer]:
        """Poses of the links at a configuration [rad or m]; see `FkOptions`."""
        return compute(robot, "fk", FkRequest.of(joints=joints, **options), FkAnswer.read)

    @Endpoint
    def fk_batch(self, robot: str, joints: RowsLike, **options: Unpack[FkOptions]) -> Call[FkBatch]:
        """Poses of the links at many configurations; see `FkOptions`."""
        return compute(robot, "fk", FkRequest.of(joints=joints, **options), FkBatch.read)

    @Endpoint
    def jacobian(
        self, robot: str, joints: VectorLike, **options: Unpack[JacobianOptions]
    ) -> Call[JacobianAnswer]:
        """The Jacobian at a configuration; see `JacobianOptions`."""
        body = JacobianRequest.of(joints=joints, **options)
        return compute(robot, "jacobian", body, JacobianAnswer.read)

    @Endpoint
    def jacobian_batch(
        self, robot: str, joints: RowsLike, **options: Unpack[JacobianOptions]
    ) -> Call[JacobianBatch]:
        """Jacobians at many configurations; see `JacobianOptions`."""
        body = JacobianRequest.of(joints=joints, **options)
        return compute(robot, "jacobian", body, JacobianBatch.read)

    @Endpoint
    def ik(
        self, robot: str, pose: Pose | None = None, **options: Unpack[IkOptions]
    ) -> Call[IkAnswer]:
        """Configurations that reach a pose or hold constraints, best first; see `IkOptions`."""
        body = IkRequest.of(pose=pose, **options)
        return compute(robot, "ik", body, IkAnswer.read, body.timeout)

    @Endpoint
    def ik_batch(
        self, robot: str, poses: Sequence[Pose], **options: Unpack[IkOptions]
    ) -> Call[IkBatch]:
        """Configurations that reach each of many poses; see `IkOptions`."""
        body = IkRequest.of(poses=list(poses), **options)
        return compute(robot, "ik", body, IkBatch.read, body.timeout)

    @Endpoint
    def velocity(
        self, robot: str, joints: VectorLike, **options: Unpack[VelocityOptions]
    ) -> Call[VelocityAnswer]:
        """The twist of joint velocities, or the least joint velocities for a twist.

        See `VelocityOptions`.
        """
        body = VelocityRequest.of(joints=joints, **options)
        return compute(robot, "velocity", body, VelocityAnswer.read)

    @Endpoint
    def wrench(
        self, robot: str, joints: VectorLike, wrench: VectorLike, **options: Unpack[WrenchOptions]
    ) -> Call[WrenchAnswer]:
        """Joint torques that balance a wrench [f; n] at the tip: τ = Jᵀ F; see `WrenchOptions`."""
        body = WrenchRequest.of(joints=joints, wrench=wrench, **options)
        return compute(robot, "wrench", body, WrenchAnswer.read)

    @Endpoint
    def wrench_of_torques(
        self, robot: str, joints: VectorLike, torques: VectorLike, **options: Unpack[WrenchOptions]
    ) -> Call[WrenchAnswer]:
        """The wrench of least length that joint torques hold, Jᵀ F = τ; see `WrenchOptions`."""
        body = WrenchRequest.of(joints=joints, torques=torques, **options)
        return compute(robot, "wrench", body, WrenchAnswer.read)

    @Endpoint
    def wrench_batch(
        self, robot: str, joints: RowsLike, wrench: VectorLike, **options: Unpack[WrenchOptions]
    ) -> Call[WrenchBatch]:
        """Joint torques that balance a wrench at many configurations; see `WrenchOptions`."""
        body = WrenchRequest.of(joints=joints, wrench=wrench, **options)
        return compute(robot, "wrench", body, WrenchBatch.read)

    @Endpoint
    def dynamics(
        self, robot: str, joints: VectorLike, **options: Unpack[DynamicsOptions[VectorLike]]
    ) -> Call[DynamicsAnswer]:
        """The equations of motion at a configuration; see `DynamicsOptions`."""
        body = DynamicsRequest.of(joints=joints, **options)
        return compute(robot, "dynamics", body, DynamicsAnswer.read)

    @Endpoint
    def dynamics_batch(
        self, robot: str, joints: RowsLike, **options: Unpack[DynamicsOptions[RowsLike]]
    ) -> Call[DynamicsBatch]:
        """The equations of motion at many configurations; see `DynamicsOptions`."""
        body = DynamicsRequest.of(joints=joints, **options)
        return compute(robot, "dynamics", body, DynamicsBatch.read)

    @Endpoint
    def forward_dynamics(
        self, robot: str, joints: VectorLike, **options: Unpack[ForwardDynamicsOptions[VectorLike]]
    ) -> Call[ForwardDynamicsAnswer]:
        """The accelerations that torques cause in a state; see `ForwardDynamicsOptions`."""
        body = ForwardDynamicsRequest.of(joints=joints, **options)
        return compute(robot, "forward-dynamics", body, ForwardDynamicsAnswer.read)

    @Endpoint
    def forward_dynamics_batch(
        self, robot: str, joints: RowsLike, **options: Unpack[ForwardDynamicsOptions[RowsLike]]
    ) -> Call[ForwardDynamicsBatch]:
        """The accelerations that torques cause in many states; see `ForwardDynamicsOptions`."""
        body = ForwardDynamicsRequest.of(joints=joints, **options)
        return compute(robot, "forward-dynamics", body, ForwardDynamicsBatch.read)

    @Endpoint
    def potential(
        self,
        robot: str,
        joints: VectorLike,
        goal_joints: VectorLike,
        scene: SceneReference | None = None,
        **settings: Unpack[PotentialSettings],
    ) -> Call[PotentialAnswer]:
        """The potential field at a configuration on the way to a goal; see `PotentialSettings`."""
        body = PotentialRequest.of(joints=joints, goal_joints=goal_joints, scene=scene, **settings)
        return compute(robot, "potential", body, PotentialAnswer.read, body.timeout)

    @Endpoint
    def potential_batch(
        self,
        robot: str,
        joints: RowsLike,
        goal_joints: VectorLike,
        scene: SceneReference | None = None,
        **settings: Unpack[PotentialSettings],
    ) -> Call[PotentialBatch]:
        """The potential field at many configurations; see `PotentialSettings`."""
        body = PotentialRequest.of(joints=joints, goal_joints=goal_joints, scene=scene, **settings)
        return compute(robot, "potential", body, PotentialBatch.read, body.timeout)

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
        return compute(robot, "regressor", body, RegressorAnswer.read)

    @Endpoint
    def identify(
        self,
        robot: str,
        logs: Sequence[LogBody | Mapping[str, object]],
        **options: Unpack[IdentifyOptions],
    ) -> Call[IdentifyAnswer]:
        """Bodies and drives of a robot, or its load, from logs; see `IdentifyOptions`."""
        body = IdentifyRequest.of(logs=list(logs), **options)
        return compute(robot, "identify", body, IdentifyAnswer.read, body.timeout)

    @Endpoint
    def excitation(
        self, robot: str, **options: Unpack[ExcitationOptions]
    ) -> Call[ExcitationAnswer]:
        """A certified motion from whose logs an arm is identified; see `ExcitationOptions`."""
        body = ExcitationRequest.of(**options)
        return compute(robot, "excitation", body, ExcitationAnswer.read, body.timeout)

    @Endpoint
    def calibrate(
        self, robot: str, joints: RowsLike, **options: Unpack[CalibrateOptions]
    ) -> Call[CalibrateAnswer]:
        """Corrections of an arm from measurements of its tip; see `CalibrateOptions`."""
        body = CalibrateRequest.of(joints=joints, **options)
        return compute(robot, "calibrate", body, CalibrateAnswer.read, body.timeout)

    # Last, since it hides the built-in type from what follows.
    @Endpoint
    def list(self, *, after: str | None = None, limit: int | None = None) -> Call[RobotList]:
        """A page of the robots, built-in ones among them, by name."""
        return Call("GET", path("robots"), RobotList.read, query=page(after, limit))

    @Endpoint
    def reach(
        self, robot: str, poses: Sequence[Pose] | ReachBox, **options: Unpack[ReachOptions]
    ) -> Call[ReachAnswer]:
        """Reach of task poses, of a list or a grid in a box; see `ReachOptions`."""
        body = _reach_request(poses, "json", options)
        return compute(robot, "reach", body, ReachAnswer.read, body.timeout)

    @Endpoint
    def reach_picture(
        self, robot: str, box: ReachBox, **options: Unpack[ReachOptions]
    ) -> Call[str]:
        """An SVG picture of the reach in a box with one orientation; see `ReachOptions`."""
        body = _reach_request(box, "svg", options)
        return compute(robot, "reach", body, bytes.decode, body.timeout)

    @Endpoint
    def reach_mesh(self, robot: str, box: ReachBox, **options: Unpack[ReachOptions]) -> Call[bytes]:
        """A coloured mesh (GLB) of what is reached in a box with one orientation."""
        body = _reach_request(box, "glb", options)
        return compute(robot, "reach", body, bytes, body.timeout)


def _reach_request(
    poses: Sequence[Pose] | ReachBox, form: str, options: ReachOptions
) -> ReachRequest:
    target = {"box": poses} if isinstance(poses, ReachBox) else {"poses": poses}
    return ReachRequest.of(format=form, **target, **options)
