"""The one table from errors to problem documents (RFC 9457)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fastapi import HTTPException

from kinematics.errors import ArmwrightError

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
    "NOT_FOUND": Kind(404, "There is no such thing"),
    "METHOD_NOT_ALLOWED": Kind(405, "The method is not possible here"),
    "REQUEST_TIMEOUT": Kind(408, "The request body did not arrive in time"),
    "CONFLICT": Kind(409, "The request conflicts with what exists"),
    "PAYLOAD_TOO_LARGE": Kind(413, "The request body is too large"),
    "UNSUPPORTED_MEDIA_TYPE": Kind(415, "The request body has the wrong content type"),
    "OVERLOADED": Kind(429, "There is too much to do at the moment"),
    "NOT_READY": Kind(503, "The service is not ready"),
}
_UNLISTED = Kind(422, "The request can't be answered")


class ProblemError(HTTPException):
    """A problem of the service's own, to be raised anywhere in a request.

    Args:
        code: One of `KINDS`.
        detail: What is wrong this time, and where.
        hint: What to do about it.
        stage: The step that failed.
        status: Another status than that of the kind.
        retry_after: Seconds after which asking again makes sense.
        details: Values a program can use.
    """

    def __init__(
        self,
        code: str,
        detail: str,
        *,
        hint: str | None = None,
        stage: str | None = None,
        status: int | None = None,
        retry_after: int | None = None,
        headers: Mapping[str, str] | None = None,
        **details: Any,
    ) -> None:
        headers = dict(headers or {})
        if retry_after is not None:
            headers["Retry-After"] = str(retry_after)
        super().__init__(status or KINDS[code].status, detail, headers)
        self.code = code
        self.hint = hint
        self.stage = stage
        self.details = details

    def document(self, instance: str) -> dict[str, Any]:
        """The problem document of this error for a request to the path `instance`."""
        return {
            "type": f"/v1/problems/{self.code}",
            "title": KINDS.get(self.code, _UNLISTED).title,
            "status": self.status_code,
            "detail": plain(self.detail),
            "instance": plain(instance),
            "code": self.code,
            "stage": self.stage,
            "hint": plain(self.hint),
            "details": plain(self.details),
        }


def from_domain(error: ArmwrightError) -> ProblemError:
    """The problem of a caller's fault that the domain found."""
    return from_fields(error.code, error.message, error.hint, error.details)


def from_fields(
    code: str, message: str, hint: str | None, details: Mapping[str, Any]
) -> ProblemError:
    """The problem of an error that came as values, say from a worker.

    A detail named `stage` becomes the stage of the problem.
    """
    rest = {str(name): value for name, value in details.items()}
    stage = rest.pop("stage", None)
    problem = ProblemError(
        code,
        message,
        hint=hint,
        stage=None if stage is None else str(stage),
        status=KINDS.get(code, _UNLISTED).status,
    )
    problem.details = rest
    return problem


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
