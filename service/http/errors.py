"""Problem documents (RFC 9457): the one table of their kinds, and the handlers of all errors."""

import asyncio
import json
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import Response
from starlette.routing import Match
from starlette.types import Scope

from kinematics.errors import ArmwrightError
from service.validation import ProblemError, from_fields, unexpected_fault, validation_problem
from service.workers.state import ShuttingDown

_log = logging.getLogger(__name__)

PROBLEM_MEDIA_TYPE = "application/problem+json"
#: Names of fields and the like in a problem are cut here, so that an answer stays readable.
_MAX_TEXT = 2_000
_MAX_DEPTH = 8


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of problem.

    Args:
        status: HTTP status.
        title: What it says in general.
        hint: What to do about it in general.
        operations: Names of the operations that may answer it, or kinds of them: "*" for all, those
            "of a name" in their path, "with a body" and those that may be answered "as a job".
        example: One occurrence: its instance, stage, detail and details.
    """

    status: int
    title: str
    hint: str
    operations: Sequence[str] = ()
    example: Mapping[str, Any] | None = None


#: Kinds by code, MoveIt's first; what is not listed is a fault in the request (422).
KINDS: Mapping[str, Kind] = {
    code: Kind(**fields)
    for code, fields in json.loads(
        files("service.http").joinpath("problems.json").read_text("utf-8")
    ).items()
}
_UNLISTED = Kind(422, "The request can't be answered", "")


def status_of(problem: ProblemError) -> int:
    """The HTTP status of a problem."""
    return problem.status or KINDS.get(problem.code, _UNLISTED).status


def headers_of(problem: ProblemError) -> dict[str, str]:
    """The headers of the answer that tells a problem."""
    if problem.retry_after is None:
        return problem.headers
    return problem.headers | {"Retry-After": str(problem.retry_after)}


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


#: What the framework raises by status, with what to do about it.
_FRAMEWORK = {
    400: ("VALIDATION_ERROR", "The body could not be parsed; /docs shows what is taken."),
    404: ("NOT_FOUND", "/docs lists the endpoints."),
    405: ("METHOD_NOT_ALLOWED", "The header Allow names the methods that are possible."),
    413: ("PAYLOAD_TOO_LARGE", None),
    415: ("UNSUPPORTED_MEDIA_TYPE", None),
}


def problem_content(problem: ProblemError, instance: str) -> bytes:
    """The problem document of a request to the path `instance`, JSON."""
    return json.dumps(document(problem, instance), ensure_ascii=False, allow_nan=False).encode()


def problem_response(problem: ProblemError, instance: str) -> Response:
    """The HTTP response of a problem for a request to the path `instance`."""
    content = problem_content(problem, instance)
    return Response(content, status_of(problem), headers_of(problem), PROBLEM_MEDIA_TYPE)


def problem_of(error: ProblemError | ArmwrightError | RequestValidationError) -> ProblemError:
    """The problem that an error is: one of ours, a fault that the domain found, or a body's."""
    if isinstance(error, ProblemError):
        return error
    if isinstance(error, ArmwrightError):
        return from_fields(error.code, error.message, error.hint, error.details)
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
    return ProblemError(code, detail, headers=headers, hint=hint, status=status)


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
