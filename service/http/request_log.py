"""Ids of requests, and a line in the log for each."""

import logging
import time

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service import logs
from service.access.caller import caller_of
from service.http.fields import field
from service.http.job_context import JOB_CONTEXT

_log = logging.getLogger("service.requests")
_NAME = b"x-request-id"


class RequestLog:
    """Middleware that gives each request an id, answers it, and logs the request under it.

    Args:
        app: The application behind it.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        context = scope.get(JOB_CONTEXT)
        identity = logs.new_request_id(field(scope, _NAME))
        request = logs.request_id.set(identity)
        job = logs.job_id.set(None if context is None else context.id)
        status, began = 0, time.perf_counter()

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                add_id(message, identity)
            await send(message)

        try:
            await self._app(scope, receive, send_with_id)
        finally:
            log_request(scope, status, time.perf_counter() - began)
            logs.job_id.reset(job)
            logs.request_id.reset(request)


def log_request(scope: Scope, status: int, seconds: float) -> None:
    """Log a request that was answered, where requests are logged.

    Args:
        scope: Of the request.
        status: Of the answer.
        seconds: Time until it was complete [s].
    """
    if not _log.isEnabledFor(logging.INFO):
        return
    key = logs.key_id.set(caller_of(scope).api_key)
    route = getattr(scope.get("route"), "path", None) or "unmatched"
    fields = {
        "method": scope["method"],
        "route": route,
        "status": status,
        "milliseconds": round(1e3 * seconds, 2),
    }
    text = "%(method)s %(route)s %(status)s %(milliseconds)s ms"
    # The message is the text itself: lines of requests are never too many of a kind.
    _log.info(text % fields, extra={"fields": fields})
    logs.key_id.reset(key)


def add_id(message: Message, identity: str) -> None:
    """Put the id of a request into the head of its answer, unless there is one."""
    headers = message.get("headers", ())
    if all(name != _NAME for name, _ in headers):
        message["headers"] = [*headers, (_NAME, identity.encode("latin-1"))]
