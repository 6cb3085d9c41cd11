"""The one table from errors to problem documents (RFC 9457)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from kinematics.errors import ArmwrightError
from service.problem import ProblemError, from_fields

PROBLEM_MEDIA_TYPE = "application/problem+json"
#: Names of fields and the like in a problem are cut here, so that an answer stays readable.
_MAX_TEXT = 2_000
_MAX_DEPTH = 8


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of problem: its HTTP status and its title."""

    status: int
    title: str


#: What is not listed here is a fault in the request (422).
KINDS: Mapping[str, Kind] = {
    # MoveIt's names.
    "START_STATE_IN_COLLISION": Kind(422, "The start configuration is in collision"),
    "GOAL_IN_COLLISION": Kind(422, "The goal configuration is in collision"),
    "START_STATE_INVALID": Kind(422, "The start configuration is not valid"),
    "GOAL_STATE_INVALID": Kind(422, "The goal configuration is not valid"),
    "START_STATE_VIOLATES_PATH_CONSTRAINTS": Kind(422, "The start violates the path constraints"),
    "GOAL_VIOLATES_PATH_CONSTRAINTS": Kind(422, "The goal violates the path constraints"),
    "NO_IK_SOLUTION": Kind(422, "No configuration reaches the pose"),
    "PLANNING_FAILED": Kind(422, "No valid motion was found"),
    "INVALID_MOTION_PLAN": Kind(422, "The motion is not valid"),
    "TIMED_OUT": Kind(504, "The deadline passed"),
    "PREEMPTED": Kind(409, "The computation was cancelled"),
    "INVALID_GROUP_NAME": Kind(422, "The robot has no such group"),
    "INVALID_LINK_NAME": Kind(422, "The robot has no such link"),
    "INVALID_OBJECT_NAME": Kind(422, "The scene has no such object"),
    "INVALID_GOAL_CONSTRAINTS": Kind(422, "The goal is malformed"),
    "INVALID_ROBOT_STATE": Kind(422, "The configuration does not fit the robot"),
    "UNRECOGNIZED_GOAL_TYPE": Kind(422, "The kind of goal is not known"),
    "CRASH": Kind(500, "The server failed"),
    # Ours.
    "INVALID_ROBOT_DESCRIPTION": Kind(422, "The robot description is not valid"),
    "INVALID_SCENE": Kind(422, "The scene is not valid"),
    "MISSING_LIMIT": Kind(422, "A limit that is needed is missing"),
    "MISSING_INERTIA": Kind(422, "A mass or inertia that is needed is missing"),
    "INVALID_REQUEST": Kind(422, "The request can't be answered"),
    "VALIDATION_ERROR": Kind(422, "The request does not have the right form"),
    "IDEMPOTENCY_KEY_REUSED": Kind(422, "The idempotency key belongs to another request"),
    "UNAUTHENTICATED": Kind(401, "Credentials are missing or wrong"),
    "FORBIDDEN": Kind(403, "The API key or the page that asks does not allow this"),
    "QUOTA_EXCEEDED": Kind(403, "The storage of this tenant is used up"),
    "NOT_FOUND": Kind(404, "There is no such thing"),
    "METHOD_NOT_ALLOWED": Kind(405, "The endpoint does not have this method"),
    "REQUEST_TIMEOUT": Kind(408, "The request body did not arrive in time"),
    "CONFLICT": Kind(409, "The request conflicts with what exists"),
    "PRECONDITION_FAILED": Kind(412, "What exists is not what the request expects"),
    "PAYLOAD_TOO_LARGE": Kind(413, "The request body is too large"),
    "UNSUPPORTED_MEDIA_TYPE": Kind(415, "The request body has the wrong content type"),
    "HOST_NOT_ALLOWED": Kind(421, "The service does not answer for this host"),
    "OUT_OF_MEMORY": Kind(422, "The request needs too much memory"),
    "OVERLOADED": Kind(429, "The service has too many requests"),
    "NOT_READY": Kind(503, "The service is not ready"),
    "STORAGE_UNAVAILABLE": Kind(503, "The storage can't be used now"),
}
_UNLISTED = Kind(422, "The request can't be answered")


class HttpProblemError(ProblemError):
    """A problem whose answer carries more headers than the usual ones.

    Args:
        code: The kind of problem.
        detail: What is wrong this time, and where.
        headers: By name.
        more: As `ProblemError` has it.
    """

    def __init__(self, code: str, detail: str, headers: Mapping[str, str], **more: Any) -> None:
        super().__init__(code, detail, **more)
        self.headers = dict(headers)


def with_headers(
    problem: ProblemError, headers: Mapping[str, str], **details: Any
) -> HttpProblemError:
    """A problem with more headers and more details."""
    more = HttpProblemError(
        problem.code,
        problem.detail,
        headers_of(problem) | dict(headers),
        hint=problem.hint,
        stage=problem.stage,
        status=problem.status,
        retry_after=problem.retry_after,
    )
    more.details = problem.details | details
    return more


def status_of(problem: ProblemError) -> int:
    """The HTTP status of a problem."""
    return problem.status or KINDS.get(problem.code, _UNLISTED).status


def headers_of(problem: ProblemError) -> dict[str, str]:
    """The headers of the answer that tells a problem."""
    headers = problem.headers if isinstance(problem, HttpProblemError) else {}
    if problem.retry_after is not None:
        headers = headers | {"Retry-After": str(problem.retry_after)}
    return headers


def document(problem: ProblemError, instance: str) -> dict[str, Any]:
    """The problem document (RFC 9457) of a request to the path `instance`."""
    return {
        "type": f"/v1/problems/{problem.code}",
        "title": KINDS.get(problem.code, _UNLISTED).title,
        "status": status_of(problem),
        "detail": plain(problem.detail),
        "instance": plain(instance),
        "code": problem.code,
        "stage": problem.stage,
        "hint": plain(problem.hint),
        "details": plain(problem.details),
    }


def from_domain(error: ArmwrightError) -> ProblemError:
    """The problem of a caller's fault that the domain found."""
    return from_fields(error.code, error.message, error.hint, error.details)


def plain(value: Any, depth: int = 0) -> Any:
    """A value as strict JSON can carry it: arrays as lists, what is not finite as null."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if value is None or isinstance(value, bool | int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping) and depth < _MAX_DEPTH:
        return {_text(name): plain(item, depth + 1) for name, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset) and depth < _MAX_DEPTH:
        return [plain(item, depth + 1) for item in value]
    return _text(value)


def _text(value: object) -> str:
    text = str(value).encode("utf-8", "replace").decode("utf-8")
    return text if len(text) <= _MAX_TEXT else f"{text[:_MAX_TEXT]}…"
