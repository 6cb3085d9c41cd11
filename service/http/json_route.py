"""Routes that take strict JSON, perhaps to be answered later as a job.

Large bodies are validated by workers, so that the event loop stays free: parsing 30 MB of JSON and
validating it takes seconds in which nobody else would be answered, in a thread as well, since it
never lets go of the interpreter.
"""

import re
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any, TypeGuard, TypeVar

from fastapi import APIRouter, Request, Response
from fastapi.params import Form
from fastapi.routing import APIRoute
from pydantic import BaseModel

from service.access.authentication import client_of
from service.http.compute import deadline_of
from service.http.idempotency import answer_once
from service.http.keeping import answer_and_keep, takes_keep
from service.http.layer.admission import named_timeout
from service.http.openapi import RESPONSES
from service.http.request_headers import FIELDS, values
from service.http.state import job_context, settings_of, supervisor_of
from service.settings import Settings
from service.task_references import outline
from service.validation import (
    check_field_count,
    parse_json,
    request_problem,
    validate_as,
)
from service.workers.result import TaskProblem

#: Bodies up to this are parsed and validated within milliseconds [byte].
INLINE_BYTES = 32 * 1024
_USUAL_TYPE = "application/json"
_JSON_TYPE = re.compile(r"application/([\w.+-]+\+)?json")
#: Methods of requests that may become jobs: GET and DELETE compute nothing.
_DEFERRABLE = ("POST", "PUT")

_Model = TypeVar("_Model", bound=BaseModel)
Handler = Callable[[Request], Coroutine[Any, Any, Response]]
#: Stores a request as a job and answers 202; the application has one as ``app.state.defer``.
Deferral = Callable[[Request, Handler], Awaitable[Response]]


class JsonRequest(Request):
    """A request whose body is parsed strictly.

    Args:
        request: Request as the framework has it.
        model: Model that the body must follow; a large body is answered as an instance of it.
    """

    def __init__(self, request: Request, model: type[BaseModel] | None = None) -> None:
        super().__init__(request.scope, request.receive)
        self._model = model

    async def json(self) -> Any:
        """The parsed body; of a large one an outline, which is valid already.

        Raises:
            ProblemError: The body is not valid JSON, or a large one does not follow its model.
        """
        if not hasattr(self, "_json"):
            content = await self.body()
            if self._model is not None and len(content) > INLINE_BYTES:
                self._json = await validated_by_worker(self, self._model, content)
            else:
                self._json = parse_json(content)
        return self._json

    async def read(self, model: type[_Model]) -> _Model:
        """The body as a model, of a large one an outline.

        Raises:
            ProblemError: It does not follow the model.
        """
        self._model = model
        value = await self.json()
        return value if isinstance(value, model) else validate_as(model, value)


class JsonRoute(APIRoute):
    """A route that takes strict JSON and nothing else where it takes a body."""

    #: Whether requests become jobs without asking for that.
    always_deferred = False

    def get_route_handler(self) -> Handler:
        """The handler of the framework behind the checks of the head and the body."""
        handle = super().get_route_handler()
        info = None if self.body_field is None else self.body_field.field_info
        annotation = None if info is None else info.annotation
        model = annotation if _is_model(annotation) else None
        takes_json = info is not None and not isinstance(info, Form)
        is_kept = takes_keep(model)
        known = {parameter.alias for parameter in self.dependant.query_params}

        async def handle_json(request: Request) -> Response:
            # The framework would hide what is wrong with the JSON behind a message of its own.
            if takes_json and await request.body():
                await request.json()
            if is_kept:
                return await answer_and_keep(request, handle)
            return await handle(request)

        async def handle_checked(request: Request) -> Response:
            strict = JsonRequest(request, model)
            if request.method == "GET" and self.path.startswith("/v1"):
                _require_known(request, known)
            if takes_json and await strict.body():
                fields = strict.scope[FIELDS]
                require_json(fields.get("content-type"))
                require_plain(fields.get("content-encoding"))
            if not _is_deferred(strict, self.always_deferred):
                return await answer_once(strict, handle_json)
            defer: Deferral = request.app.state.defer
            return await answer_once(strict, lambda request: defer(request, handle_json))

        return handle_checked


class JobRoute(JsonRoute):
    """A route whose requests always become jobs."""

    always_deferred = True


def json_router(
    tag: str, prefix: str = "/v1", *, route_class: type[JsonRoute] = JsonRoute
) -> APIRouter:
    """Router of endpoints that take strict JSON and answer problems as documented.

    Args:
        tag: Group of the endpoints in the OpenAPI document.
        prefix: Beginning of their paths.
        route_class: Class of their routes.
    """
    return APIRouter(prefix=prefix, tags=[tag], route_class=route_class, responses=RESPONSES)


def require_json(content_type: str | None) -> None:
    """Check a Content-Type header.

    Raises:
        ProblemError: UNSUPPORTED_MEDIA_TYPE, it is not JSON.
    """
    if content_type == _USUAL_TYPE:
        return
    media_type = (content_type or "").split(";")[0].strip().lower()
    if not _JSON_TYPE.fullmatch(media_type):
        raise request_problem(
            "UNSUPPORTED_MEDIA_TYPE",
            f"this endpoint takes JSON, not {media_type or 'a body without a content type'}",
            hint="Send the header Content-Type: application/json.",
        )


def require_plain(content_encoding: str | None) -> None:
    """Check a Content-Encoding header: bodies are taken as they are.

    Raises:
        ProblemError: UNSUPPORTED_MEDIA_TYPE, the body is compressed.
    """
    encoding = (content_encoding or "identity").strip().lower()
    if encoding != "identity":
        raise request_problem(
            "UNSUPPORTED_MEDIA_TYPE",
            f"bodies that are encoded ({encoding[:40]}) are not taken",
            hint="Send the JSON as it is, without Content-Encoding; answers are compressed "
            "for Accept-Encoding: gzip.",
        )


def _require_known(request: Request, known: set[str]) -> None:
    """Refuse query parameters that a GET does not take.

    Raises:
        ProblemError: VALIDATION_ERROR, with their names.
    """
    unknown = [name for name in request.query_params if name not in known]
    if unknown:
        taken = ", ".join(sorted(known)) or "none"
        raise request_problem(
            "VALIDATION_ERROR",
            "; ".join(f"{name[:40]}: unknown query parameter" for name in unknown[:5]),
            hint=f"Query parameters that this endpoint takes: {taken}.",
        )


def _is_model(annotation: Any) -> TypeGuard[type[BaseModel]]:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def prefers_async(values: list[str]) -> bool:
    """Whether headers Prefer (RFC 7240) name the preference respond-async."""
    if not values:
        return False
    preferences = ",".join(values).split(",")
    names = (preference.split(";")[0].split("=")[0] for preference in preferences)
    return any(name.strip().lower() == "respond-async" for name in names)


def _is_deferred(request: Request, always: bool) -> bool:
    """Whether a request becomes a job: it prefers that, or its route always makes one."""
    if request.method not in _DEFERRABLE or job_context(request) is not None:
        return False
    if always or "prefer" not in request.scope[FIELDS]:
        return always
    return prefers_async(values(request.scope, b"prefer"))


async def validated_by_worker(
    request: Request, model: type[BaseModel], content: bytes
) -> BaseModel:
    """An instance of a body's model, validated by a worker, with parts cut short.

    Raises:
        ProblemError: VALIDATION_ERROR; as `check_field_count` and `WorkerSupervisor.submit`.
    """
    check_field_count(content)
    settings = settings_of(request)
    seconds = settings.max_timeout
    if job_context(request) is None:  # a job has its time once it is taken up
        seconds = _time_to_validate(model, content, settings)
    job = outline.job(f"{model.__module__}:{model.__qualname__}", content)
    result = await supervisor_of(request).submit(
        job.with_deadline(deadline_of(request, seconds)), client=client_of(request.scope)
    )
    if isinstance(result, TaskProblem):
        raise result.error
    return result


def _time_to_validate(model: type[BaseModel], content: bytes, settings: Settings) -> float:
    """Time that a body may take to be validated: that of its request, if it may name one [s]."""
    if "timeout" not in model.model_fields:
        return settings.max_timeout
    return named_timeout(content, settings)
