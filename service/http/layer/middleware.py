"""The layer around the application: what every request passes, from top to bottom.

Checks stand in the order of what they cost, and of what they tell about the service: the head, host
and origin, credentials, rate, load, and the body at last. Whatever is refused on the way becomes a
problem document, with the same headers as all answers.
"""

import asyncio
import logging
import time
from contextlib import nullcontext

from fastapi import FastAPI
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.middleware.cors import CORSMiddleware
from starlette.middleware.gzip import GZipMiddleware, IdentityResponder
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service import logs
from service.access.authentication import CALLER, Authenticator, Caller, caller_of, needed_scope
from service.access.rate_limit import Allowance, RateLimiter
from service.http.errors import response_to
from service.http.layer.admission import Admission
from service.http.layer.request_checks import (
    ARRIVAL,
    BodyLimits,
    check_head,
    check_host,
    offers_upgrade,
    read_body,
)
from service.http.metrics import Metrics
from service.http.request_headers import FIELDS, accepts_gzip, first_values
from service.http.state import JOB_CONTEXT
from service.settings import Settings
from service.storage.stores.key_store import ApiKey
from service.storage.stores.key_store import Scope as NeededScope
from service.validation import ProblemError, request_problem

#: Headers of every answer that has not its own. Answers are data: nothing in them may be run, shown
#: in a frame or taken for another type.
SECURITY_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
_SECURITY_FIELDS = [(n.lower().encode(), v.encode()) for n, v in SECURITY_HEADERS.items()]
#: Paths that an agent answers.
HEALTH_PATHS = ("/healthz", "/readyz", "/metrics")
#: Answers from this size on are compressed for clients that accept gzip [byte].
COMPRESSED_SIZE = 4096
#: Answers from this size on are compressed in a thread [byte]: shorter ones take less than a
#: millisecond, in which nobody else is answered.
_THREAD_SIZE = 32 * 1024
#: Level of compression: higher ones take several times as long for a few per cent.
_LEVEL = 1
#: Headers of answers that pages of other origins may read.
_EXPOSED = [
    "ETag", "Location", "Retry-After", "Preference-Applied", "Idempotency-Replayed",
    "WWW-Authenticate", "RateLimit-Limit", "RateLimit-Remaining", "RateLimit-Reset",
]  # fmt: skip
#: Headers of requests that pages of other origins may send.
_SENT = [
    "Authorization", "Content-Type", "Idempotency-Key", "If-Match", "If-None-Match", "Prefer",
    "X-API-Key",
]  # fmt: skip
#: Key in the scope of a request, with the `ApiKey` that it has shown.
_KEY = "armwright.api_key"
#: Key in the scope of a request, with the headers to add to its answer.
_ADDED = "armwright.added_headers"
#: In a scope whose answer has begun: its status.
_STATUS = "armwright.status"
_CHALLENGE = 'Bearer realm="armwright"'
#: For refusals that leave the body unread: the connection can't be used again.
_CLOSE = {"Connection": "close"}

_log = logging.getLogger("service.requests")


class ServiceMiddleware:
    """Identity, log, metrics, checks and headers of every request.

    Args:
        app: The application behind it.
        application: Application whose state holds authenticator and admission once it runs.
        settings: Limits, hosts, origins, and what anybody may ask.
        metrics: Counters of requests.
        health_only: Whether nothing but `HEALTH_PATHS` is answered, as by an agent.
    """

    def __init__(
        self,
        app: ASGIApp,
        application: FastAPI,
        settings: Settings,
        metrics: Metrics,
        *,
        health_only: bool = False,
    ) -> None:
        self._app = app
        self._compressing = GZipMiddleware(app, COMPRESSED_SIZE, _LEVEL, _THREAD_SIZE)
        self._state = application.state
        self._settings = settings
        self._metrics = metrics
        self._health_only = health_only
        self._limiter = RateLimiter()
        self._body_limits = BodyLimits(
            settings.max_body_size, settings.body_timeout, settings.body_deadline
        )
        self._answer: ASGIApp = self._answer_checked
        if settings.origins:
            self._answer = CORSMiddleware(
                self._answer_checked,
                allow_origins=list(settings.origins),
                allow_methods=["GET", "POST", "PUT", "PATCH", "DELETE"],
                allow_headers=_SENT,
                expose_headers=_EXPOSED,
            )
        _log.setLevel(logging.INFO if settings.log_requests else logging.WARNING)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request under an id, count it and log it."""
        if scope["type"] == "websocket":
            await self._open_socket(scope, receive, send)
            return
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        began, status = time.perf_counter(), 0
        scope[ARRIVAL] = time.monotonic()
        job = scope.get(JOB_CONTEXT)
        fields = scope[FIELDS] = first_values(scope)
        identity = logs.new_request_id(fields.get("x-request-id"))
        request_token = logs.request_id.set(identity)
        job_token = logs.job_id.set(None if job is None else job.id)
        added = [*_SECURITY_FIELDS, (b"x-request-id", identity.encode("latin-1"))]
        scope[_ADDED] = added
        if "upgrade" in fields and offers_upgrade(
            scope
        ):  # the parser drops what was sent behind the offer
            added.append((b"connection", b"close"))

        async def send_with_headers(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = scope[_STATUS] = message["status"]
                headers = message.get("headers", ())
                own = {name for name, _ in headers}
                message["headers"] = [*headers, *[item for item in added if item[0] not in own]]
            await send(message)

        try:
            await self._answer(scope, receive, send_with_headers)
        finally:
            seconds = time.perf_counter() - began
            # A path that no route has is whatever somebody typed.
            route = getattr(scope.get("route"), "path", None) or "unmatched"
            if job is None:
                self._metrics.count_request(route, scope["method"], status or 500, seconds)
            _log_request(scope, route, status, seconds)
            logs.job_id.reset(job_token)
            logs.request_id.reset(request_token)

    async def _open_socket(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Have a WebSocket served that passes all checks; refuse others with a problem document."""
        scope["method"], scope[_ADDED], scope[FIELDS] = "POST", [], first_values(scope)
        try:
            self._check_head(scope)
            await self._check_access(scope)
            self._take_rate(scope)
        except ProblemError as error:
            response = response_to(error, scope, started=False)
            assert response is not None
            await response(scope, receive, send)
            return
        await self._app(scope, receive, send)

    async def _answer_checked(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request that passes all checks, and others with a problem document."""
        try:
            if JOB_CONTEXT in scope:  # it passed them when it was accepted
                await self._encoded(scope)(scope, receive, send)
            else:
                self._check_head(scope)
                await self._check_access(scope)
                scope[_ADDED] += self._take_rate(scope)
                await self._answer_admitted(scope, receive, send)
        except (Exception, asyncio.CancelledError) as error:  # noqa: BLE001  (raised again or told)
            response = response_to(error, scope, started=_STATUS in scope)
            if response is not None:
                await response(scope, receive, send)

    def _check_head(self, scope: Scope) -> None:
        """Check what the head of a request tells.

        Raises:
            ProblemError: INVALID_REQUEST, HOST_NOT_ALLOWED, FORBIDDEN.
            ProblemError: NOT_FOUND.
        """
        check_head(scope)
        if self._health_only and scope["path"] not in HEALTH_PATHS:
            raise request_problem(
                "NOT_FOUND",
                "an agent answers for its health and metrics only",
                hint=f"GET {', '.join(HEALTH_PATHS)}; ask a server for everything else.",
            )
        check_host(scope, self._settings.host_names, self._settings.origins)

    async def _check_access(self, scope: Scope) -> None:
        """Check that the caller may ask this, and note who it is.

        Raises:
            ProblemError: UNAUTHENTICATED, FORBIDDEN.
            ProblemError: STORAGE_UNAVAILABLE.
        """
        needed = needed_scope(
            scope["method"],
            scope["path"],
            public_health=self._settings.public_health,
            public_metrics=self._settings.public_metrics,
        )
        authenticator: Authenticator | None = getattr(self._state, "authenticator", None)
        # Before the start there is neither storage nor a worker to reach.
        if needed is None or authenticator is None:
            return
        headers = Headers(scope=scope)
        try:
            if authenticator.is_remembered(headers):
                caller, key = authenticator.authenticate(headers)
            else:
                caller, key = await run_in_threadpool(authenticator.authenticate, headers)
        except ProblemError as problem:
            if problem.code != "UNAUTHENTICATED":
                raise
            shown = "authorization" in headers or "x-api-key" in headers
            challenge = f'{_CHALLENGE}, error="invalid_token"' if shown else _CHALLENGE
            problem.headers |= {"WWW-Authenticate": challenge} | _CLOSE
            raise
        if not caller.may(needed):
            raise _forbidden(caller, needed)
        scope[CALLER], scope[_KEY] = caller, key

    def _take_rate(self, scope: Scope) -> list[tuple[bytes, bytes]]:
        """Count a request against the rate of its API key.

        Returns:
            The headers of its answer that tell what is left.

        Raises:
            ProblemError: OVERLOADED.
        """
        key: ApiKey | None = scope.get(_KEY)
        if key is None or key.rate is None:
            return []
        allowance = self._limiter.take(key.id, key.rate)
        if not allowance.granted:
            raise _too_many(allowance)
        return [(n.lower().encode(), v.encode()) for n, v in _rate_headers(allowance).items()]

    async def _answer_admitted(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request that the service has time for, once its body is there.

        Raises:
            ProblemError: PAYLOAD_TOO_LARGE, REQUEST_TIMEOUT, OVERLOADED.
            ClientDisconnect: The client left before.
        """
        admission: Admission | None = getattr(self._state, "admission", None)
        if admission is not None:
            await admission.check_announced(scope)
        unread = [await read_body(scope, receive, self._body_limits)]

        async def receive_stored() -> Message:
            if unread:
                return {"type": "http.request", "body": unread.pop(), "more_body": False}
            return await receive()  # what remains to come is the disconnection, whenever that is

        async with nullcontext() if admission is None else admission.admitted(scope, unread[0]):
            await self._encoded(scope)(scope, receive_stored, send)

    def _encoded(self, scope: Scope) -> ASGIApp:
        """The application as it answers a client: compressed where that takes it."""
        if accepts_gzip(scope):
            return self._compressing
        # Says in the header Vary that it would be for others.
        return IdentityResponder(self._app, COMPRESSED_SIZE)


def _log_request(scope: Scope, route: str, status: int, seconds: float) -> None:
    if not _log.isEnabledFor(logging.INFO):
        return
    key = logs.key_id.set(caller_of(scope).api_key)
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


def _forbidden(caller: Caller, needed: NeededScope) -> ProblemError:
    return ProblemError(
        "FORBIDDEN",
        f"this needs an API key of the scope {needed}; the one that was shown has {caller.scope}",
        headers={"WWW-Authenticate": f'{_CHALLENGE}, error="insufficient_scope", scope="{needed}"'}
        | _CLOSE,
        stage="request",
        hint="Use another key. Whoever runs the service makes one with `armwright keys create`.",
        needed=needed,
        scope=caller.scope,
    )


def _too_many(allowance: Allowance) -> ProblemError:
    return ProblemError(
        "OVERLOADED",
        f"this API key allows {allowance.limit} requests a minute",
        headers=_rate_headers(allowance) | _CLOSE,
        stage="request",
        hint="Ask again after the time in Retry-After.",
        retry_after=allowance.retry_after,
    )


def _rate_headers(allowance: Allowance) -> dict[str, str]:
    return {
        "RateLimit-Limit": str(allowance.limit),
        "RateLimit-Remaining": str(allowance.remaining),
        "RateLimit-Reset": str(allowance.reset),
    }
