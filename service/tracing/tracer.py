"""Spans of requests, and of jobs, which are requests that are answered later.

Spans by OpenTelemetry, of jobs in queue and worker as well, and where they are sent.
"""

import re
import threading
from collections import OrderedDict
from typing import Any

from opentelemetry import context
from opentelemetry.context import Context, get_current
from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
from opentelemetry.sdk.resources import SERVICE_NAME, SERVICE_VERSION, Resource
from opentelemetry.sdk.trace import SpanLimits, TracerProvider
from opentelemetry.sdk.trace.export import (
    BatchSpanProcessor,
    SimpleSpanProcessor,
    SpanExporter,
)
from opentelemetry.trace import (
    Span,
    SpanContext,
    SpanKind,
    Status,
    StatusCode,
    Tracer,
    get_current_span,
    set_span_in_context,
)
from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service import logs
from service.access.authentication import caller_of
from service.http.state import JOB_CONTEXT, JobContext
from service.version import VERSION

#: Stages that are words name their spans; others have text of a request in them.
_WORD = re.compile(r"[a-z_]{1,40}")
#: Codes of faults of the service itself.
_OWN_FAULTS = frozenset({"CRASH", "TIMED_OUT", "OUT_OF_MEMORY"})


class JobTrace:
    """The spans of one job in its queue and in its worker, a `Watch`.

    Args:
        tracer: Makes the spans.
        task: The name of the task, ``"module:function"``.
    """

    def __init__(self, tracer: Tracer, task: str) -> None:
        self._tracer = tracer
        self._task = task
        self._parent = get_current()
        self._stage_name = ""
        self._stage: Span | None = None
        self._inner = self._parent
        self._span = self._start("queue", self._parent)

    def waits(self) -> None:
        """End the span of a worker that was lost, and begin that of another wait."""
        self.ends("lost")
        self._span = self._start("queue", self._parent)

    def begins(self) -> None:
        """End the span of the wait, and begin that of the worker."""
        self._span.end()
        self._span = self._start("worker", self._parent)
        self._inner = set_span_in_context(self._span, self._parent)

    def reaches(self, stage: str) -> None:
        """Begin the span of a stage, unless it is the one that goes on."""
        if stage == self._stage_name:
            return
        if self._stage is not None:
            self._stage.end()
        name = stage if _WORD.fullmatch(stage) else "stage"
        self._stage_name = stage
        self._stage = self._tracer.start_span(
            name, self._inner, attributes={"armwright.stage": stage}
        )

    def ends(self, outcome: str) -> None:
        """End all spans."""
        if self._stage is not None:
            self._stage.end()
        self._stage, self._stage_name = None, ""
        self._span.set_attribute("armwright.outcome", outcome)
        if outcome in _OWN_FAULTS:
            self._span.set_status(Status(StatusCode.ERROR, outcome))
        self._span.end()

    def _start(self, name: str, parent: Context) -> Span:
        return self._tracer.start_span(name, parent, attributes={"armwright.task": self._task})


#: Longest time in which a collector must take what it is sent, retries included [s].
_EXPORT_TIMEOUT = 2.0
#: Longest wait for the last spans when the service ends [s].
_CLOSING_TIME = 2.0
#: Text beyond this is cut: paths are whatever somebody typed.
_ATTRIBUTE_LENGTH = 256
#: Jobs of which it is known which request they were made by.
_JOBS = 4096


class Tracing:
    """The traces of one application.

    The variables ``OTEL_*`` of the environment hold too: the sampler, the name of the service,
    headers for the collector.

    Args:
        exporter: Takes the spans.
        at_once: Whether the exporter is given each span as it ends, in place of batches by a
            thread.
    """

    def __init__(self, exporter: SpanExporter, *, at_once: bool = False) -> None:
        resource = Resource.create({SERVICE_VERSION: VERSION})
        if str(resource.attributes[SERVICE_NAME]).startswith("unknown_service"):
            resource = resource.merge(Resource({SERVICE_NAME: "armwright"}))
        limits = SpanLimits(max_attribute_length=_ATTRIBUTE_LENGTH)
        self._provider = TracerProvider(
            resource=resource, span_limits=limits, shutdown_on_exit=False
        )
        processor = SimpleSpanProcessor(exporter) if at_once else BatchSpanProcessor(exporter)
        self._provider.add_span_processor(processor)
        self.tracer = self._provider.get_tracer("armwright", VERSION)
        self._requests: OrderedDict[str, SpanContext] = OrderedDict()

    def watch(self, task: str) -> JobTrace | None:
        """The trace of a job that begins to wait, part of the request that is being answered."""
        request = get_current_span()
        if request.get_span_context().is_valid and not request.is_recording():
            return None
        return JobTrace(self.tracer, task)

    def note_job(self, job_id: str, request: Span) -> None:
        """Note which request a job was made by."""
        self._requests[job_id] = request.get_span_context()
        while len(self._requests) > _JOBS:
            self._requests.popitem(last=False)

    def link_job(self, job_id: str, span: Span) -> None:
        """Link the span of a job with that of the request that it was made by, if it is known."""
        request = self._requests.pop(job_id, None)
        if request is not None:
            span.add_link(request)

    def close(self, longest: float = _CLOSING_TIME) -> None:
        """Send what there is and end.

        Args:
            longest: Time that a collector has which does not answer [s].
        """
        closing = threading.Thread(target=self._provider.shutdown, daemon=True)
        closing.start()
        closing.join(longest)


def http_exporter(url: str) -> SpanExporter:
    """An exporter to a collector that speaks OTLP over HTTP."""
    return OTLPSpanExporter(url, timeout=_EXPORT_TIMEOUT)


#: The context of what belongs to no request.
NO_CONTEXT = Context()


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
