"""Problem documents (RFC 9457): the one table of their kinds, and the handlers of all errors."""

import asyncio
import json
import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import Response
from starlette.routing import Match
from starlette.types import Scope

from kinematics.errors import ArmwrightError
from service.problem import ProblemError, from_fields, unexpected_fault
from service.validation import validation_problem
from service.workers.faults import ShuttingDown

_log = logging.getLogger(__name__)

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
    "CERTIFICATE_DISPUTED": Kind(500, "A second look does not agree with the proof"),
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
        detail: Fault of this one request, and its place.
        headers: Headers by name.
        more: Further arguments of `ProblemError`.
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


PROBLEM_HINTS: Mapping[str, str] = {
    "START_STATE_IN_COLLISION": (
        "Move the arm away from what `details.pair` names, or allow the pair if it may touch."
    ),
    "GOAL_IN_COLLISION": (
        "Move the goal, lower the margin, or allow the pair that `details.pair` names."
    ),
    "START_STATE_INVALID": (
        "Bring the joint that `details` names inside its limits, or raise `start_state_tolerance`."
    ),
    "GOAL_STATE_INVALID": "Choose a goal inside the joint limits that `details` names.",
    "START_STATE_VIOLATES_PATH_CONSTRAINTS": (
        "Start where the constraint holds, or widen its tolerance."
    ),
    "GOAL_VIOLATES_PATH_CONSTRAINTS": (
        "Choose a goal where the constraint holds, or widen its tolerance."
    ),
    "NO_IK_SOLUTION": (
        "Ask with `all_solutions` to see why candidates were rejected; loosen tolerances "
        "or free an axis."
    ),
    "PLANNING_FAILED": (
        "Read `details` for what is in the way; give more time, another planner or a "
        "smaller margin."
    ),
    "INVALID_MOTION_PLAN": (
        "Read which limit, constraint or pair is violated, and when; change the motion there."
    ),
    "TIMED_OUT": "Raise `timeout`, make the request smaller, or ask with `Prefer: respond-async`.",
    "PREEMPTED": (
        "The job was cancelled or its client left. Ask again if the answer is still wanted."
    ),
    "INVALID_GROUP_NAME": "Name a group of the robot's SRDF.",
    "INVALID_LINK_NAME": "Name one of the links that `GET /v1/robots/{name}` lists.",
    "INVALID_OBJECT_NAME": "Name an obstacle of the scene.",
    "INVALID_GOAL_CONSTRAINTS": "Correct the field that `detail` names.",
    "INVALID_ROBOT_STATE": "Give one number for each joint, in the order of `joint_names`.",
    "UNRECOGNIZED_GOAL_TYPE": "Give `joints`, `state`, `pose` or `any_of`.",
    "CERTIFICATE_DISPUTED": "Do not run the motion. Report `GET /v1/plans/{plan_id}/bundle`: "
    "it holds all that the answer depends on.",
    "CRASH": "Ask again. If it happens again, report the request with the log of the service.",
    "INVALID_ROBOT_DESCRIPTION": "Correct the URDF, SRDF or table where `detail` says.",
    "INVALID_SCENE": "Correct the obstacle that `detail` names.",
    "MISSING_LIMIT": "Give the limit in `joint_limits`, or a rule in `default_limits`.",
    "MISSING_INERTIA": "Give masses and inertias of all links, or leave out what needs them.",
    "INVALID_REQUEST": "Change what `detail` names; the form of the request is right.",
    "VALIDATION_ERROR": "Correct the fields that `details.errors` lists; `/docs` has their form.",
    "IDEMPOTENCY_KEY_REUSED": "Take a new key for a new request.",
    "UNAUTHENTICATED": "Send an API key as `Authorization: Bearer aw_...` or `X-API-Key`.",
    "FORBIDDEN": "Ask with a key that has the scope which `detail` names; of a page, list its "
    "origin in `cors_origins`.",
    "QUOTA_EXCEEDED": "Delete robots, scenes or plans, or have the storage of the tenant raised.",
    "NOT_FOUND": "Check the name; lists such as `GET /v1/robots` show those there are.",
    "METHOD_NOT_ALLOWED": "Take a method that the header `Allow` names.",
    "REQUEST_TIMEOUT": "Send the body faster, or in fewer bytes.",
    "CONFLICT": "Choose another name, or wait until the other request has ended.",
    "PRECONDITION_FAILED": "Fetch what is there now, and send its new `ETag`.",
    "PAYLOAD_TOO_LARGE": "Send less, or have `ARMWRIGHT_MAX_BODY_SIZE` raised.",
    "UNSUPPORTED_MEDIA_TYPE": "Send `Content-Type: application/json`, or a form for an archive.",
    "HOST_NOT_ALLOWED": "Ask under an allowed name, or have it added to `ARMWRIGHT_ALLOWED_HOSTS`.",
    "OUT_OF_MEMORY": "Make the request smaller, or have `ARMWRIGHT_WORKER_MEMORY` raised.",
    "OVERLOADED": "Wait as long as `Retry-After` says, and ask again.",
    "NOT_READY": (
        "Wait as long as `Retry-After` says; kernels are being compiled, or workers start."
    ),
    "STORAGE_UNAVAILABLE": "Wait; the database is locked, full or away. The log says which.",
}


#: What the framework raises by status, with what to do about it.
_FRAMEWORK = {
    400: ("VALIDATION_ERROR", "The body could not be parsed; /docs shows what is taken."),
    404: ("NOT_FOUND", "/docs lists the endpoints."),
    405: ("METHOD_NOT_ALLOWED", "The header Allow names the methods that are possible."),
    413: ("PAYLOAD_TOO_LARGE", None),
    415: ("UNSUPPORTED_MEDIA_TYPE", None),
}


def problem_response(problem: ProblemError, instance: str) -> Response:
    """The HTTP response of a problem for a request to the path `instance`."""
    content = json.dumps(document(problem, instance), ensure_ascii=False, allow_nan=False)
    return Response(
        content.encode("utf-8"), status_of(problem), headers_of(problem), PROBLEM_MEDIA_TYPE
    )


def problem_of(error: ProblemError | ArmwrightError | RequestValidationError) -> ProblemError:
    """The problem that an error is."""
    if isinstance(error, ProblemError):
        return error
    if isinstance(error, ArmwrightError):
        return from_domain(error)
    return validation_problem(error.errors(), error.body)


def install(app: FastAPI) -> None:
    """Answer every error that reaches the framework with a problem document."""

    async def on_fault(request: Request, error: Exception) -> Response:
        assert isinstance(error, ProblemError | ArmwrightError | RequestValidationError)
        return problem_response(problem_of(error), request.url.path)

    async def on_http(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        if request.method == "OPTIONS" and error.status_code == 405:
            return Response(None, 204, {"Allow": ", ".join(_possible_methods(request))})
        return problem_response(_from_framework(request, error), request.url.path)

    for fault in (ProblemError, ArmwrightError, RequestValidationError):
        app.add_exception_handler(fault, on_fault)
    app.add_exception_handler(HTTPException, on_http)


def _from_framework(request: Request, error: HTTPException) -> ProblemError:
    code, hint = _FRAMEWORK.get(error.status_code, ("INVALID_REQUEST", None))
    detail = f"{request.method} {request.url.path}: {error.detail}"
    status = 422 if error.status_code == 400 else error.status_code
    headers = dict(error.headers or {})
    if status == 405:
        headers["Allow"] = ", ".join(_possible_methods(request))
    return HttpProblemError(code, detail, headers, hint=hint, status=status)


def _possible_methods(request: Request) -> list[str]:
    """All methods of a path; the framework names only those of the first route that has it."""
    routes = request.app.router.routes
    return [
        method
        for method in ("GET", "POST", "PUT", "PATCH", "DELETE")
        if any(r.matches({**request.scope, "method": method})[0] is Match.FULL for r in routes)
    ]


def response_to(
    error: Exception | asyncio.CancelledError, scope: Scope, *, started: bool
) -> Response | None:
    """The response to a request in which an error was raised that no layer below has answered.

    Called while the error is handled.

    Args:
        error: Exception that was raised: one of ours, a mistake, or the end of the service.
        scope: Scope of the request.
        started: Whether a response has begun: all that is left is to break the connection off.

    Returns:
        The response; None where the client is gone.

    Raises:
        Exception: The error itself, where it can't be answered.
    """
    if isinstance(error, ClientDisconnect):
        _log.debug("the client of %s left before its request was complete", scope["path"])
        return None
    problem: ProblemError | None = None
    if isinstance(error, ProblemError):  # of another layer
        problem = error
    elif not isinstance(error, asyncio.CancelledError):
        problem = unexpected_fault(f"{scope['method']} {scope['path']}")
    elif scope["app"].state.stopping:
        # The service ends, and the request has used up the time that it had for that.
        problem = ShuttingDown()
    if problem is None or started:
        raise error
    return problem_response(problem, scope["path"])
