"""Typed client of the Armwright motion planning service.

`Client` and `AsyncClient` are where to begin; `armwright_client.errors` shows the tree of errors,
`armwright_client.models` lists requests and answers.
"""

from armwright_client import geometry, models, seam, task, tour
from armwright_client.arm_models import *  # noqa: F403 (mypy does not follow the list of models)
from armwright_client.client import (
    DEFAULT_URL,
    AsyncClient,
    AsyncJobs,
    AsyncLater,
    AsyncPlans,
    AsyncRobots,
    AsyncScenes,
    Client,
    Jobs,
    Later,
    Plans,
    Robots,
    Scenes,
)
from armwright_client.error_codes import BY_CODE
from armwright_client.errors import (
    ApiError,
    ArmwrightError,
    Conflict,
    Forbidden,
    GoalInCollision,
    GoalStateInvalid,
    GoalViolatesPathConstraints,
    HostNotAllowed,
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
    OutOfMemory,
    OutsideLimits,
    Overloaded,
    PayloadTooLarge,
    PlanningFailed,
    PreconditionFailed,
    Preempted,
    QuotaExceeded,
    RequestTimeout,
    StartStateInCollision,
    StartStateInvalid,
    StartStateViolatesPathConstraints,
    StorageUnavailable,
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
from armwright_client.geometry import *  # noqa: F403 (likewise)
from armwright_client.kept_plan import *  # noqa: F403 (likewise)
from armwright_client.models import *  # noqa: F403 (its `__all__` is the list)
from armwright_client.pending import AsyncPending, Pending
from armwright_client.retry import Retry
from armwright_client.seam import *  # noqa: F403 (likewise)
from armwright_client.session import ClientOptions
from armwright_client.task import *  # noqa: F403 (likewise)
from armwright_client.task_stage import *  # noqa: F403 (likewise)
from armwright_client.timing import RuledLimits, TimingReport
from armwright_client.tour import *  # noqa: F403 (likewise)
from armwright_client.version import VERSION

__version__ = VERSION

__all__ = [
    "BY_CODE",
    "DEFAULT_URL",
    "ApiError",
    "ArmwrightError",
    "AsyncClient",
    "AsyncJobs",
    "AsyncLater",
    "AsyncPending",
    "AsyncPlans",
    "AsyncRobots",
    "AsyncScenes",
    "Client",
    "ClientOptions",
    "Conflict",
    "Forbidden",
    "GoalInCollision",
    "GoalStateInvalid",
    "GoalViolatesPathConstraints",
    "HostNotAllowed",
    "IdempotencyKeyReused",
    "InCollision",
    "InvalidArgument",
    "InvalidGoalConstraints",
    "InvalidGroupName",
    "InvalidLinkName",
    "InvalidMotionPlan",
    "InvalidObjectName",
    "InvalidRequest",
    "InvalidRobotDescription",
    "InvalidRobotState",
    "InvalidScene",
    "Jobs",
    "Later",
    "MethodNotAllowed",
    "MissingInertia",
    "MissingLimit",
    "NoIkSolution",
    "NoWay",
    "NotFound",
    "NotReady",
    "OutOfMemory",
    "OutsideLimits",
    "Overloaded",
    "PayloadTooLarge",
    "Pending",
    "PlanningFailed",
    "Plans",
    "PreconditionFailed",
    "Preempted",
    "QuotaExceeded",
    "RequestTimeout",
    "Retry",
    "Robots",
    "RuledLimits",
    "Scenes",
    "StartStateInCollision",
    "StartStateInvalid",
    "StartStateViolatesPathConstraints",
    "StorageUnavailable",
    "TimedOut",
    "TimingReport",
    "TransportError",
    "TransportTimeout",
    "Unauthenticated",
    "Unavailable",
    "UnexpectedAnswer",
    "UnrecognizedGoalType",
    "UnsupportedMediaType",
    "ValidationFailed",
    "WorkerCrashed",
    "__version__",
]
__all__ += models.__all__
__all__ += geometry.__all__
__all__ += task.__all__
__all__ += seam.__all__
__all__ += tour.__all__
