"""How request bodies are read: strict JSON of a limited size that arrives in time."""

import asyncio
import math
import re
from collections.abc import Callable, Coroutine, Iterator
from typing import Any, TypeGuard, TypeVar

from fastapi import Request, Response
from fastapi.params import Form
from fastapi.routing import APIRoute
from pydantic import BaseModel
from pydantic_core import from_json
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.http.deferral import is_postponed, postponed
from service.http.errors import ProblemError
from service.http.idempotency import answer_once
from service.http.large_body import INLINE_BYTES, outlined
from service.http.validation import validated

_JSON_TYPE = re.compile(r"application/([\w.+-]+\+)?json")
_MAX_LISTED = 20

_Model = TypeVar("_Model", bound=BaseModel)
Handler = Callable[[Request], Coroutine[Any, Any, Response]]


def parse_json(content: bytes) -> Any:
    """Parse JSON as RFC 8259 has it: UTF-8, no NaN or Infinity, no lone surrogates.

    Raises:
        ProblemError: VALIDATION_ERROR with the position, or with the path of each number that is
            not finite.
    """
    try:
        return from_json(content, allow_inf_nan=False)
    except ValueError as error:
        raise _malformed(content, str(error)) from None


def _malformed(content: bytes, message: str) -> ProblemError:
    try:
        lenient = from_json(content, allow_inf_nan=True)
    except ValueError:
        paths = []
    else:
        paths = [path for _, path in zip(range(_MAX_LISTED), _not_finite(lenient), strict=False)]
    if paths:
        return ProblemError(
            "VALIDATION_ERROR",
            f"{', '.join(paths)}: not a finite number; JSON has no NaN or Infinity",
            stage="request",
            errors=[{"path": path, "problem": "not a finite number"} for path in paths],
        )
    return ProblemError(
        "VALIDATION_ERROR",
        f"the body is not valid JSON: {message}",
        stage="request",
        hint="Send one JSON value in UTF-8.",
        errors=[{"path": "body", "problem": message}],
    )


def _not_finite(value: Any, path: str = "") -> Iterator[str]:
    if isinstance(value, dict):
        for name, item in value.items():
            yield from _not_finite(item, f"{path}.{name}" if path else name)
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from _not_finite(item, f"{path}[{index}]")
    elif isinstance(value, float) and not math.isfinite(value):
        yield path or "body"


class JsonRequest(Request):
    """A request whose body is parsed strictly.

    Args:
        request: As the framework has it.
        model: What the body must follow; a large one is answered as an instance of it.
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
                self._json = await outlined(self, self._model, content)
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
        return value if isinstance(value, model) else validated(model, value)


class JsonRoute(APIRoute):
    """A route that takes strict JSON and nothing else where it takes a body."""

    #: Whether requests become jobs without asking for that.
    always_postponed = False

    def get_route_handler(self) -> Handler:
        """The handler of the framework behind the checks of the body."""
        handle = super().get_route_handler()
        annotation = None if self.body_field is None else self.body_field.field_info.annotation
        model = annotation if _is_model(annotation) else None
        takes_json = self.body_field is not None and not isinstance(
            self.body_field.field_info, Form
        )

        async def checked(request: Request) -> Response:
            strict = JsonRequest(request, model)
            if takes_json and await strict.body():
                require_json(strict.headers.get("content-type"))
            if is_postponed(strict, self.always_postponed):
                return await answer_once(strict, lambda request: postponed(request, handle))
            return await answer_once(strict, handle)

        return checked


def _is_model(annotation: Any) -> TypeGuard[type[BaseModel]]:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


class JobRoute(JsonRoute):
    """A route whose requests always become jobs."""

    always_postponed = True


def require_json(content_type: str | None) -> None:
    """Check a Content-Type header.

    Raises:
        ProblemError: UNSUPPORTED_MEDIA_TYPE, it is not JSON.
    """
    media_type = (content_type or "").split(";")[0].strip().lower()
    if not _JSON_TYPE.fullmatch(media_type):
        raise ProblemError(
            "UNSUPPORTED_MEDIA_TYPE",
            f"this endpoint takes JSON, not {media_type or 'a body without a content type'}",
            stage="request",
            hint="Send the header Content-Type: application/json.",
        )


class BodyLimit:
    """Middleware that refuses bodies that are too large or that stop arriving.

    Args:
        app: The application behind it.
        max_size: Largest body [byte], with a Content-Length or without.
        timeout: Longest silence within a body [s].
    """

    def __init__(self, app: ASGIApp, max_size: int, timeout: float) -> None:
        self._app = app
        self._max_size = max_size
        self._timeout = timeout

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        announced = Headers(scope=scope).get("content-length", "")
        too_large = announced.isdigit() and (
            len(announced) > len(str(self._max_size)) or int(announced) > self._max_size
        )
        size, complete = 0, False

        async def limited() -> Message:
            nonlocal size, complete
            if complete:  # what remains to come is the disconnection, whenever that is
                return await receive()
            if too_large:
                raise self._too_large()
            message = await self._in_time(receive)
            size += len(message.get("body", b""))
            complete = not message.get("more_body", False)
            if size > self._max_size:
                raise self._too_large()
            return message

        await self._app(scope, limited, send)

    async def _in_time(self, receive: Receive) -> Message:
        try:
            # Not wait_for: until Python 3.12 it may swallow a cancellation.
            async with asyncio.timeout(self._timeout):
                return await receive()
        except TimeoutError:
            raise ProblemError(
                "REQUEST_TIMEOUT",
                f"nothing of the body arrived for {self._timeout:g} s",
                stage="request",
                headers={"Connection": "close"},
            ) from None

    def _too_large(self) -> ProblemError:
        return ProblemError(
            "PAYLOAD_TOO_LARGE",
            f"the body is larger than {self._max_size} bytes",
            stage="request",
            hint="Split the request, or raise ARMWRIGHT_MAX_BODY_SIZE where the service is run.",
            headers={"Connection": "close"},
            max_body_size=self._max_size,
        )
