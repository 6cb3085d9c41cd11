"""Replay of stored requests through the application, which answers them like new ones."""

import asyncio
import json
from collections.abc import MutableMapping
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive

from service.access.authentication import CALLER
from service.http.state import JOB_CONTEXT, JobContext
from service.storage.stores.job_store import JobAnswer, StoredRequest


@dataclass(slots=True)
class Replayed:
    """Answer of the application to a replayed request."""

    status: int = 500
    headers: Headers = field(default_factory=Headers)
    body: bytearray = field(default_factory=bytearray)

    @property
    def answer(self) -> JobAnswer:
        """The body and its type."""
        content_type = self.headers.get("content-type", "application/octet-stream")
        return JobAnswer(content_type, bytes(self.body))

    @property
    def is_storage_fault(self) -> bool:
        """Whether nothing else was wrong than that the storage could not be used."""
        if self.status != HTTPStatus.SERVICE_UNAVAILABLE:
            return False
        return bool(json.loads(self.body).get("code") == "STORAGE_UNAVAILABLE")


async def replay(app: ASGIApp, request: StoredRequest, context: JobContext) -> Replayed:
    """The answer to a stored request.

    Args:
        app: The whole application, so that errors become problem documents here too.
        request: Request as it came.
        context: Context of the job that the request belongs to.
    """
    return await send_again(app, _scope(request, context), request.body, _nobody_leaves)


async def send_again(
    app: ASGIApp, scope: MutableMapping[str, Any], body: bytes, then: Receive
) -> Replayed:
    """The answer of an application to a request whose body is known.

    Args:
        app: The application, or a part of it.
        scope: Scope of the request.
        body: The body.
        then: Receives what comes after the body.
    """
    answered = Replayed()
    unread = [body]

    async def receive() -> Message:
        if unread:
            return {"type": "http.request", "body": unread.pop(), "more_body": False}
        return await then()

    async def send(message: Message) -> None:
        if message["type"] == "http.response.start":
            answered.status = message["status"]
            answered.headers = Headers(raw=list(message["headers"]))
        elif message["type"] == "http.response.body":
            answered.body += message.get("body", b"")

    await app(scope, receive, send)
    return answered


async def _nobody_leaves() -> Message:
    await asyncio.Event().wait()
    raise AssertionError


def _scope(request: StoredRequest, context: JobContext) -> MutableMapping[str, Any]:
    return {
        "type": "http",
        "asgi": {"version": "3.0"},
        "http_version": "1.1",
        "method": request.method,
        "path": request.path,
        "raw_path": request.path.encode(),
        "query_string": b"",
        "root_path": "",
        "scheme": "http",
        "headers": [
            (b"content-type", request.content_type.encode("latin-1")),
            (b"content-length", str(len(request.body)).encode()),
        ],
        "client": None,
        "server": None,
        JOB_CONTEXT: context,
        CALLER: context.caller,
    }
