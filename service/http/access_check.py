"""Access check: every request is that of a caller who may make it, at the rate that it may."""

from fastapi import FastAPI
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.access.authentication import Authenticator
from service.access.caller import ANYONE, CALLER, Caller
from service.access.rate_limit import Allowance, RateLimiter
from service.access.rules import needed_scope
from service.http.errors import HttpProblemError
from service.http.job_context import JOB_CONTEXT
from service.problem import ProblemError
from service.settings import Settings
from service.storage.key_store import Scope as NeededScope

_CHALLENGE = 'Bearer realm="armwright"'
#: The body of what is refused is not read, so the connection can't be used again.
_CLOSE = {"Connection": "close"}


class AccessCheck:
    """Middleware that authenticates callers and refuses what they may not ask.

    Args:
        app: The application behind it.
        application: That holds the `Authenticator`, once it has started.
        settings: They say what anybody may ask.
    """

    def __init__(self, app: ASGIApp, application: FastAPI, settings: Settings) -> None:
        self._app = app
        self._state = application.state
        self._settings = settings
        self._limiter = RateLimiter()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on.

        Raises:
            HttpProblemError: UNAUTHENTICATED, FORBIDDEN, OVERLOADED.
            ProblemError: STORAGE_UNAVAILABLE.
        """
        if scope["type"] != "http" or JOB_CONTEXT in scope:
            await self._app(scope, receive, send)
            return
        needed = needed_scope(
            scope["method"],
            scope["path"],
            public_health=self._settings.public_health,
            public_metrics=self._settings.public_metrics,
        )
        if needed is None:
            await self._app(scope, receive, send)
            return
        caller, rate = await self._authenticate(Headers(scope=scope))
        if not caller.may(needed):
            raise _forbidden(caller, needed)
        scope[CALLER] = caller
        if rate is None or caller.api_key is None:
            await self._app(scope, receive, send)
            return
        allowance = self._limiter.take(caller.api_key, rate)
        if not allowance.granted:
            raise _too_many(allowance)

        async def send_with_rate(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(_rate_headers(allowance))
            await send(message)

        await self._app(scope, receive, send_with_rate)

    async def _authenticate(self, headers: Headers) -> tuple[Caller, int | None]:
        authenticator: Authenticator | None = getattr(self._state, "authenticator", None)
        if authenticator is None:  # not started: there is neither storage nor a worker to reach
            return ANYONE, None
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
            raise HttpProblemError(
                problem.code,
                problem.detail,
                {"WWW-Authenticate": challenge} | _CLOSE,
                stage=problem.stage,
                hint=problem.hint,
            ) from None
        return caller, None if key is None else key.rate


def _forbidden(caller: Caller, needed: NeededScope) -> HttpProblemError:
    return HttpProblemError(
        "FORBIDDEN",
        f"this needs an API key of the scope {needed}; the one that was shown has {caller.scope}",
        {"WWW-Authenticate": f'{_CHALLENGE}, error="insufficient_scope", scope="{needed}"'}
        | _CLOSE,
        stage="request",
        hint="Use another key. Whoever runs the service makes one with `armwright keys create`.",
        needed=needed,
        scope=caller.scope,
    )


def _too_many(allowance: Allowance) -> HttpProblemError:
    return HttpProblemError(
        "OVERLOADED",
        f"this API key allows {allowance.limit} requests a minute",
        _rate_headers(allowance) | _CLOSE,
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
