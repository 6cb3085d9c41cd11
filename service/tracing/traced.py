"""Spans of requests, and of jobs, which are requests that are answered later."""

import re
from typing import Any

from opentelemetry import context
from opentelemetry.trace import Span, SpanKind, Status, StatusCode, set_span_in_context
from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service import logs
from service.access.caller import caller_of
from service.http.state import JOB_CONTEXT, JobContext
from service.tracing.tracer import NO_CONTEXT, Tracing

_PROPAGATOR = TraceContextTextMapPropagator()
#: Probes would be most of all traces, and tell nothing.
_UNTRACED = frozenset({"/healthz", "/readyz", "/metrics"})
_METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "DELETE", "OPTIONS", "PATCH"})
_JOB_LOCATION = re.compile(r"/v1/jobs/([^/]+)")
_ACCEPTED = 202


class Traced:
    """Middleware that makes a span of each request, in the trace of its caller.

    Args:
        app: The application behind it.
        tracing: Makes the spans.
    """

    def __init__(self, app: ASGIApp, tracing: Tracing) -> None:
        self._app = app
        self._tracing = tracing

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on."""
        if scope["type"] != "http" or scope["path"] in _UNTRACED:
            await self._app(scope, receive, send)
            return
        job: JobContext | None = scope.get(JOB_CONTEXT)
        # A job is a trace of its own: whichever request was the last has nothing to do with it.
        parent = NO_CONTEXT if job is not None else _callers_context(Headers(scope=scope))
        method = _method(scope)
        span = self._tracing.tracer.start_span(
            method,
            parent,
            SpanKind.SERVER if job is None else SpanKind.CONSUMER,
            {
                "http.request.method": method,
                "url.path": scope["path"],
                "url.scheme": scope["scheme"],
            },
        )
        status = 0

        async def send_and_note(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                self._note_answer(span, status, Headers(raw=list(message["headers"])))
            await send(message)

        attached = context.attach(set_span_in_context(span, parent))
        traced = logs.trace_id.set(f"{span.get_span_context().trace_id:032x}")
        try:
            await self._app(scope, receive, send_and_note)
        finally:
            logs.trace_id.reset(traced)
            context.detach(attached)
            self._end(span, scope, status, job)

    def _note_answer(self, span: Span, status: int, headers: Headers) -> None:
        identity = headers.get("x-request-id")
        if identity is not None:
            span.set_attribute("armwright.request_id", identity)
        made = _JOB_LOCATION.fullmatch(headers.get("location", ""))
        if status == _ACCEPTED and made is not None:
            span.set_attribute("armwright.job_id", made[1])
            self._tracing.note_job(made[1], span)

    def _end(self, span: Span, scope: Scope, status: int, job: JobContext | None) -> None:
        method = _method(scope)
        route: Any = getattr(scope.get("route"), "path", None)
        if route is not None:
            span.set_attribute("http.route", route)
        name = method if route is None else f"{method} {route}"
        span.update_name(name if job is None else f"job {name}")
        if status:
            span.set_attribute("http.response.status_code", status)
        else:  # it was cancelled, or its server ends
            span.set_attribute("armwright.outcome", "cancelled")
        key = caller_of(scope).api_key
        if key is not None:
            span.set_attribute("armwright.key_id", key)
        if job is not None:
            span.set_attribute("armwright.job_id", job.id)
            self._tracing.link_job(job.id, span)
        if status >= 500:
            span.set_status(Status(StatusCode.ERROR))
        span.end()


def _method(scope: Scope) -> str:
    return scope["method"] if scope["method"] in _METHODS else "_OTHER"


def _callers_context(headers: Headers) -> context.Context:
    """The trace that a caller names in its headers `traceparent` and `tracestate` (W3C)."""
    return _PROPAGATOR.extract(dict(headers), NO_CONTEXT)
