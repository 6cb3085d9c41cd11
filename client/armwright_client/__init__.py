"""Typed client of the Armwright motion planning service.

`Client` and `AsyncClient` are where to begin; `armwright_client.errors` shows the tree of errors.
"""

from armwright_client.base import ArrayLike, RowsLike, VectorLike
from armwright_client.batch import BatchAnswer, BatchProblem, BatchRequest
from armwright_client.certificate import (
    Certificate,
    LimitUse,
    LimitUses,
    LimitValues,
    PathDeviation,
    ValidateOptions,
    ValidateRequest,
)
from armwright_client.check import (
    Attached,
    CheckAnswer,
    CheckBatch,
    CheckOptions,
    CheckRequest,
    Collision,
    LimitViolation,
)
from armwright_client.client import (
    DEFAULT_URL,
    AsyncClient,
    AsyncJobs,
    AsyncLater,
    AsyncRobots,
    AsyncScenes,
    Client,
    Jobs,
    Later,
    Robots,
    Scenes,
)
from armwright_client.constraint import (
    BoxRegion,
    ClearanceConstraint,
    ConstraintUse,
    JointConstraint,
    LineRegion,
    LookAtConstraint,
    OrientationConstraint,
    PlaneRegion,
    PositionConstraint,
    RelativePoseConstraint,
    SphereRegion,
    ToolSpeedConstraint,
    TorqueConstraint,
)
from armwright_client.dynamics import (
    BaseParameter,
    DampedDirection,
    DynamicsAnswer,
    DynamicsBatch,
    DynamicsRequest,
    ModelOptions,
    Payload,
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
from armwright_client.error_codes import BY_CODE
from armwright_client.errors import (
    ApiError,
    ArmwrightError,
    Conflict,
    GoalInCollision,
    GoalStateInvalid,
    GoalViolatesPathConstraints,
    IdempotencyKeyReused,
    InCollision,
    InvalidArgument,
    InvalidGoalConstraints,
    InvalidGroupName,
    InvalidLinkName,
    InvalidMotionPlan,
    InvalidObjectName,
    InvalidRequest,
    InvalidRobotDescription,
    InvalidRobotState,
    InvalidScene,
    MethodNotAllowed,
    MissingInertia,
    MissingLimit,
    NoIkSolution,
    NotFound,
    NotReady,
    NoWay,
    OutsideLimits,
    Overloaded,
    PayloadTooLarge,
    PlanningFailed,
    Preempted,
    RequestTimeout,
    StartStateInCollision,
    StartStateInvalid,
    StartStateViolatesPathConstraints,
    TimedOut,
    TransportError,
    TransportTimeout,
    Unauthenticated,
    Unavailable,
    UnexpectedAnswer,
    UnrecognizedGoalType,
    UnsupportedMediaType,
    ValidationFailed,
    WorkerCrashed,
)
from armwright_client.goal import Goal, GoalLike, SingleGoal, Start
from armwright_client.health import Health, Readiness
from armwright_client.job import Job, JobEvent, JobList
from armwright_client.kinematics import (
    FkAnswer,
    FkBatch,
    FkRequest,
    Gradient,
    GradientTrace,
    IkAnswer,
    IkBatch,
    IkOptions,
    IkRequest,
    IkSolution,
    JacobianAnswer,
    JacobianBatch,
    JacobianOptions,
    JacobianRequest,
    Unsolved,
)
from armwright_client.pending import AsyncPending, Pending
from armwright_client.plan import (
    CartesianOptions,
    Descent,
    Path,
    Plan,
    PlanOptions,
    PlanRequest,
    Progress,
    Refine,
    Reproducibility,
    Stage,
    Timing,
    ToolMotion,
    ToolMotionReport,
)
from armwright_client.pose import Pose
from armwright_client.potential import (
    ControlPoint,
    PotentialAnswer,
    PotentialBatch,
    PotentialOptions,
    PotentialRequest,
)
from armwright_client.problem import Problem
from armwright_client.retime import Retimed, RetimePath, RetimeRequest, RetimeTiming
from armwright_client.retry import Retry
from armwright_client.robot import (
    DerivedDh,
    DhParameters,
    DhRow,
    DhTable,
    JointLimits,
    Limits,
    Robot,
    RobotArchive,
    RobotList,
    RobotOptions,
    RobotSummary,
    RobotUpload,
)
from armwright_client.scene import (
    Obstacle,
    ProjectAnswer,
    Projection,
    ProjectRequest,
    Scene,
    SceneList,
    SceneReference,
    SceneSummary,
)
from armwright_client.session import ClientOptions
from armwright_client.shape import (
    Box,
    Capsule,
    Cone,
    Convex,
    Cylinder,
    Halfspace,
    Mesh,
    PointCloud,
    Shape,
    Sphere,
)
from armwright_client.simulation import (
    SimulatedController,
    SimulateOptions,
    SimulateRequest,
    Simulation,
    SimulationReference,
    Tube,
)
from armwright_client.trajectory import Samples, Segment, TimedTrajectory, Trajectory
from armwright_client.version import VERSION

__version__ = VERSION

# fmt: off
__all__ = [
    "BY_CODE", "DEFAULT_URL", "ApiError", "ArmwrightError", "ArrayLike", "AsyncClient",
    "AsyncJobs", "AsyncLater", "AsyncPending", "AsyncRobots", "AsyncScenes", "Attached",
    "BaseParameter", "BatchAnswer", "BatchProblem", "BatchRequest", "Box", "BoxRegion",
    "Capsule", "CartesianOptions", "Certificate", "CheckAnswer", "CheckBatch", "CheckOptions",
    "CheckRequest", "ClearanceConstraint", "Client", "ClientOptions", "Collision", "Cone",
    "Conflict", "ConstraintUse", "ControlPoint", "Convex", "Cylinder", "DampedDirection",
    "DerivedDh", "Descent", "DhParameters", "DhRow", "DhTable", "DynamicsAnswer",
    "DynamicsBatch", "DynamicsRequest", "FkAnswer", "FkBatch", "FkRequest", "Goal",
    "GoalInCollision", "GoalLike", "GoalStateInvalid", "GoalViolatesPathConstraints",
    "Gradient", "GradientTrace", "Halfspace", "Health", "IdempotencyKeyReused", "IkAnswer",
    "IkBatch", "IkOptions", "IkRequest", "IkSolution", "InCollision", "InvalidArgument",
    "InvalidGoalConstraints", "InvalidGroupName", "InvalidLinkName", "InvalidMotionPlan",
    "InvalidObjectName", "InvalidRequest", "InvalidRobotDescription", "InvalidRobotState",
    "InvalidScene", "JacobianAnswer", "JacobianBatch", "JacobianOptions", "JacobianRequest",
    "Job", "JobEvent", "JobList", "Jobs", "JointConstraint", "JointLimits", "Later", "LimitUse",
    "LimitUses", "LimitValues", "LimitViolation", "Limits", "LineRegion", "LookAtConstraint",
    "Mesh", "MethodNotAllowed", "MissingInertia", "MissingLimit", "ModelOptions",
    "NoIkSolution", "NoWay", "NotFound", "NotReady", "Obstacle", "OrientationConstraint",
    "OutsideLimits", "Overloaded", "Path", "PathDeviation", "Payload", "PayloadTooLarge",
    "Pending", "Plan", "PlanOptions", "PlanRequest", "PlaneRegion", "PlanningFailed",
    "PointCloud", "Pose", "PositionConstraint", "PotentialAnswer", "PotentialBatch",
    "PotentialOptions", "PotentialRequest", "Preempted", "Problem", "Progress", "ProjectAnswer",
    "ProjectRequest", "Projection", "Readiness", "Refine", "RegressorAnswer",
    "RegressorOptions", "RegressorRequest", "RelativePoseConstraint", "Reproducibility",
    "RequestTimeout", "RetimePath", "RetimeRequest", "RetimeTiming", "Retimed", "Retry",
    "Robot", "RobotArchive", "RobotList", "RobotOptions", "RobotSummary", "RobotUpload",
    "Robots", "RowsLike", "Samples", "Scene", "SceneList", "SceneReference", "SceneSummary",
    "Scenes", "Segment", "Shape", "SimulateOptions", "SimulateRequest", "SimulatedController",
    "Simulation", "SimulationReference", "SingleGoal", "Sphere", "SphereRegion", "Stage",
    "Start", "StartStateInCollision", "StartStateInvalid", "StartStateViolatesPathConstraints",
    "TimedOut", "TimedTrajectory", "Timing", "ToolMotion", "ToolMotionReport",
    "ToolSpeedConstraint", "TorqueConstraint", "Trajectory", "TransportError",
    "TransportTimeout", "Tube", "Unauthenticated", "Unavailable", "UnexpectedAnswer",
    "UnrecognizedGoalType", "Unsolved", "UnsupportedMediaType", "ValidateOptions",
    "ValidateRequest", "ValidationFailed", "VectorLike", "VelocityAnswer", "VelocityOptions",
    "VelocityRequest", "WorkerCrashed", "WrenchAnswer", "WrenchBatch", "WrenchOptions",
    "WrenchRequest", "__version__",
]
# fmt: on
