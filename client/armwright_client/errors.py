"""Errors of this library, as one tree.

::

    ArmwrightError
    ├── InvalidArgument                 refused here, nothing was sent
    ├── TransportError                  no answer: no connection, broken off
    │   └── TransportTimeout            no answer in time
    ├── UnexpectedAnswer                an answer, but not one of the service's
    └── ApiError                        a problem the service reports, by its code
        ├── InCollision
        │   ├── StartStateInCollision   START_STATE_IN_COLLISION
        │   └── GoalInCollision         GOAL_IN_COLLISION
        ├── NoWay
        │   ├── PlanningFailed          PLANNING_FAILED
        │   └── TimedOut                TIMED_OUT
        ├── OutsideLimits
        │   ├── StartStateInvalid       START_STATE_INVALID
        │   ├── GoalStateInvalid        GOAL_STATE_INVALID
        │   └── InvalidRobotState       INVALID_ROBOT_STATE
        ├── Unavailable                 asking again later makes sense
        │   ├── Overloaded              OVERLOADED
        │   ├── NotReady                NOT_READY
        │   └── StorageUnavailable      STORAGE_UNAVAILABLE
        └── one class for every other code, see `BY_CODE`
"""

import re
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any, ClassVar

from armwright_wire import errors as common
from armwright_wire.plans.job import Problem


def items(value: object) -> list[object]:
    """The items of a list; none of anything else."""
    return list(value) if isinstance(value, list) else []


def joints_of(value: object) -> list[float] | None:
    """The joints of a state; None where it has none."""
    match value:
        case {"joints": [*joints]}:
            numbers = [number(q) for q in joints]
            return [q for q in numbers if q is not None] if None not in numbers else None
    return None


def number(value: object) -> float | None:
    """A number as float; None of anything else, truth values among them."""
    return None if isinstance(value, bool) or not isinstance(value, int | float) else float(value)


ArmwrightError = common.ArmwrightError
InvalidArgument = common.InvalidArgument


class TransportError(ArmwrightError):
    """No answer came: the service can't be reached, or the connection broke off."""


class TransportTimeout(TransportError):
    """No answer came in time."""


class UnexpectedAnswer(ArmwrightError):
    """The answer is none of the service's, say a page of a proxy in between.

    Args:
        message: Request, and the answer that came.
        status: The HTTP status.
        excerpt: The beginning of the body.
    """

    def __init__(self, message: str, status: int, excerpt: str = "") -> None:
        super().__init__(message, status, excerpt)
        self.message = message
        self.status = status
        self.excerpt = excerpt

    def __str__(self) -> str:
        return f"{self.message}: {self.excerpt}" if self.excerpt else self.message


class ApiError(ArmwrightError):
    """A problem that the service reports.

    Args:
        problem: The document.
        status: The HTTP status.
        retry_after: Seconds after which asking again makes sense, where the service says so.
    """

    #: The code of the problems that are raised as this class; empty for a class of several.
    code: ClassVar[str] = ""

    def __init_subclass__(cls) -> None:
        """Take the code from the name: ``NOT_FOUND`` of ``NotFound``, where none is given."""
        super().__init_subclass__()
        if "code" not in vars(cls):
            cls.code = re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).upper()

    def __init__(self, problem: Problem, status: int, retry_after: float | None = None) -> None:
        super().__init__(problem, status, retry_after)
        self.problem = problem
        self.status = status
        self.retry_after = retry_after

    def __str__(self) -> str:
        problem = self.problem
        detail = problem.detail or problem.title or f"HTTP status {self.status}"
        text = f"{problem.code}: {detail}" if problem.code else detail
        return f"{text}. {problem.hint}" if problem.hint else text

    @property
    def details(self) -> Mapping[str, Any]:
        """Values of this occurrence."""
        return self.problem.details


class InCollision(ApiError):
    """A configuration is in collision."""

    code = ""

    @property
    def pair(self) -> tuple[str, str] | None:
        """The two that penetrate each other."""
        match self.details.get("pair"):
            case [str(first), str(second)]:
                return first, second
        return None

    @property
    def depth(self) -> float | None:
        """Depth of the overlap [m]."""
        return number(self.details.get("depth"))

    @property
    def nearest_valid(self) -> list[float] | None:
        """Joints nearby that are free, where some were found; `details` say how far off."""
        return joints_of(self.details.get("nearest_valid"))


class StartStateInCollision(InCollision):
    """The start configuration is in collision."""


class GoalInCollision(InCollision):
    """The goal configuration is in collision."""


class OutsideLimits(ApiError):
    """A configuration does not fit the robot."""

    code = ""

    @property
    def joint(self) -> str | None:
        """The joint that is outside its limits, where it is that."""
        joint = self.details.get("joint")
        return joint if isinstance(joint, str) else None

    @property
    def value(self) -> float | None:
        """Its value [rad or m]."""
        return number(self.details.get("value"))

    @property
    def limit(self) -> float | None:
        """The limit it violates [rad or m]."""
        return number(self.details.get("limit"))


class StartStateInvalid(OutsideLimits):
    """The start configuration is not valid."""


class GoalStateInvalid(OutsideLimits):
    """The goal configuration is not valid."""


class InvalidRobotState(OutsideLimits):
    """A joint vector has the wrong length or lies outside the limits."""


class StartStateViolatesPathConstraints(ApiError):
    """The start violates the path constraints."""


class GoalViolatesPathConstraints(ApiError):
    """The goal violates the path constraints."""


class NoIkSolution(ApiError):
    """No configuration reaches the pose."""


class NoWay(ApiError):
    """No motion was found; what is in the way, as far as the service found out."""

    code = ""

    @property
    def blocked_by(self) -> list[tuple[tuple[str, str], float]]:
        """Pairs that stopped motions, with their share of those that were stopped."""
        found = []
        for item in items(self.details.get("blocked_by")):
            match item:
                case {"pair": [str(first), str(second)], "share": int() | float() as share}:
                    found.append(((first, second), float(share)))
        return found

    @property
    def would_unblock(self) -> list[str]:
        """Obstacles of which each, removed alone, opens a path that was found."""
        return [name for name in items(self.details.get("would_unblock")) if isinstance(name, str)]

    @property
    def reason(self) -> str | None:
        """Why a motion of the tool ends early: its `reason`."""
        reason = self.details.get("reason")
        return reason if isinstance(reason, str) else None

    @property
    def fraction(self) -> float | None:
        """Share of the tool's motions that can be carried out."""
        return number(self.details.get("fraction"))

    @property
    def nearest(self) -> list[float] | None:
        """Joints where the tool's motion ends."""
        return joints_of(self.details.get("nearest"))


class PlanningFailed(NoWay):
    """No valid motion was found."""


class InvalidMotionPlan(ApiError):
    """The motion is malformed or not valid."""


class TimedOut(NoWay):
    """The deadline of the request passed in the service."""


class Preempted(ApiError):
    """The computation was cancelled."""


class InvalidGroupName(ApiError):
    """The robot has no such group."""


class InvalidLinkName(ApiError):
    """The robot has no such link."""


class InvalidObjectName(ApiError):
    """The scene has no such object."""


class InvalidGoalConstraints(ApiError):
    """The goal or a pose is malformed."""


class UnrecognizedGoalType(ApiError):
    """The kind of goal is not known."""


class WorkerCrashed(ApiError):
    """The service failed; `details` may hold the reference under which it was logged."""

    code = "CRASH"


class CertificateDisputed(ApiError):
    """A second look by other code does not agree with a proof: the motion must not be run."""


class InvalidRobotDescription(ApiError):
    """The URDF, SRDF or DH table does not describe a robot that can be built."""


class InvalidScene(ApiError):
    """A shape, an obstacle or a planning-scene text is malformed."""


class MissingLimit(ApiError):
    """A limit that is needed is given neither by the robot nor by the request."""


class MissingInertia(ApiError):
    """A mass or inertia that is needed is not given by the robot."""


class InvalidRequest(ApiError):
    """The request can't be answered."""


class ValidationFailed(ApiError):
    """The request does not have the right form; `details["errors"]` lists the fields."""

    code = "VALIDATION_ERROR"


class IdempotencyKeyReused(ApiError):
    """The idempotency key belongs to another request."""


class Unauthenticated(ApiError):
    """Credentials are missing or wrong."""


class Forbidden(ApiError):
    """The API key does not allow this; `details` name the scope that is needed."""


class QuotaExceeded(ApiError):
    """Robots and scenes would take more storage than the API key allows."""


class NotFound(ApiError):
    """There is nothing of that name."""


class MethodNotAllowed(ApiError):
    """The service is another version, which has the path but not the method."""


class RequestTimeout(ApiError):
    """The body of the request did not arrive in time."""


class Conflict(ApiError):
    """The request conflicts with what exists, say by its name."""


class PreconditionFailed(ApiError):
    """Resource was changed meanwhile: it is not what the request expects."""


class PayloadTooLarge(ApiError):
    """The body of the request is larger than the service takes."""


class UnsupportedMediaType(ApiError):
    """The body of the request has a content type that the service does not take."""


class HostNotAllowed(ApiError):
    """The service does not answer under the name that it was asked by."""


class OutOfMemory(ApiError):
    """The request needs more memory than the service gives to one."""


class Unavailable(ApiError):
    """The service can't answer now; `retry_after` says when to ask again."""

    code = ""


class Overloaded(Unavailable):
    """The service has too many requests."""


class NotReady(Unavailable):
    """The service is still starting."""


class StorageUnavailable(Unavailable):
    """The database of the service is locked, full or away."""


def _kinds(base: type[ApiError]) -> Iterator[type[ApiError]]:
    for kind in base.__subclasses__():
        yield kind
        yield from _kinds(kind)


#: The class of every code that the service may answer.
BY_CODE: Mapping[str, type[ApiError]] = MappingProxyType(
    {kind.code: kind for kind in _kinds(ApiError) if kind.code}
)


def from_problem(problem: Problem, status: int, retry_after: float | None = None) -> ApiError:
    """The error of a problem document; `ApiError` itself for a code that is not known here."""
    return BY_CODE.get(problem.code, ApiError)(problem, status, retry_after)
