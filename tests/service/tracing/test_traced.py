"""Traces of requests and jobs of a real service."""

import itertools
import json
from collections.abc import Sequence

import httpx
from opentelemetry.sdk.trace import ReadableSpan
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter
from opentelemetry.trace import SpanKind, StatusCode

from tests.service.jobs.requests import EASY, ended, submit
from tests.service.processes import wait_until
from tests.service.robots import answer

_NUMBERS = itertools.count(1)
CALLER = 0xC0FFEE


class Trace:
    """The trace that a caller names, as it comes out.

    Args:
        spans: Where all spans are written.
    """

    def __init__(self, spans: InMemorySpanExporter) -> None:
        self.id = 0xABC0000000000000000000000000 + next(_NUMBERS)
        self._spans = spans

    def headers(self, flags: str = "01") -> dict[str, str]:
        return {"traceparent": f"00-{self.id:032x}-{CALLER:016x}-{flags}"}

    @property
    def spans(self) -> Sequence[ReadableSpan]:
        done = self._spans.get_finished_spans()
        return [span for span in done if trace_id(span) == self.id]

    def request(self) -> ReadableSpan:
        """The span of the request, which is the last to end."""
        assert wait_until(lambda: any(kind(span) is SpanKind.SERVER for span in self.spans), 20.0)
        (span,) = [span for span in self.spans if kind(span) is SpanKind.SERVER]
        return span


def kind(span: ReadableSpan) -> SpanKind:
    return span.kind


def trace_id(span: ReadableSpan) -> int:
    assert span.context is not None
    return int(span.context.trace_id)


def attributes(span: ReadableSpan) -> dict[str, object]:
    return dict(span.attributes or {})


def below(parent: ReadableSpan, spans: Sequence[ReadableSpan]) -> list[ReadableSpan]:
    """The spans right below one, in the order in which they began."""
    assert parent.context is not None
    own = parent.context.span_id
    found = [span for span in spans if span.parent is not None and span.parent.span_id == own]
    return sorted(found, key=lambda span: span.start_time or 0)


def test_a_plan_is_a_trace_of_queue_worker_and_stages(
    faulty_client: httpx.Client, spans: InMemorySpanExporter
) -> None:
    trace = Trace(spans)
    headers = trace.headers() | {"X-Request-Id": "traced-1"}
    planned = answer(faulty_client.post("/v1/plan", json=EASY, headers=headers))
    request = trace.request()
    assert request.name == "POST /v1/plan"
    assert request.parent is not None
    assert request.parent.span_id == CALLER
    told = attributes(request)
    assert (told["http.route"], told["http.response.status_code"]) == ("/v1/plan", 200)
    assert told["armwright.request_id"] == "traced-1"
    assert request.status.status_code is StatusCode.UNSET
    # A second call has the document of the robot, where a worker had not prepared it before.
    parts = below(request, trace.spans)
    assert {part.name for part in parts} == {"queue", "worker"}
    worker = parts[-1]
    assert attributes(worker)["armwright.task"] == "service.endpoints.plan.task:plan"
    assert attributes(worker)["armwright.outcome"] == "finished"
    stages = below(worker, trace.spans)
    assert [stage.name for stage in stages] == [stage["name"] for stage in planned["stages"]]
    for outer, inner in [(request, worker), *((worker, stage) for stage in stages)]:
        assert inner.start_time is not None
        assert inner.end_time is not None
        assert (outer.start_time or 0) <= inner.start_time
        assert inner.end_time <= (outer.end_time or 0)


def test_faults_of_the_service_are_errors(
    faulty_client: httpx.Client, spans: InMemorySpanExporter
) -> None:
    for path, status, outcome in [
        ("overrun", 504, "TIMED_OUT"),
        ("die", 500, "CRASH"),
        ("stumble", 500, None),
    ]:
        trace = Trace(spans)
        response = faulty_client.get(f"/mishaps/{path}", headers=trace.headers())
        assert response.status_code == status
        request = trace.request()
        assert request.status.status_code is StatusCode.ERROR
        assert attributes(request)["http.response.status_code"] == status
        ends = [attributes(span).get("armwright.outcome") for span in below(request, trace.spans)]
        assert ends[-1:] == ([] if outcome is None else [outcome])
    trace = Trace(spans)
    assert faulty_client.get("/v1/robots/nobody", headers=trace.headers()).status_code == 404
    assert trace.request().name == "GET /v1/robots/{name}"
    assert trace.request().status.status_code is StatusCode.UNSET


def test_callers_say_whether_there_is_a_trace_and_probes_have_none(
    faulty_client: httpx.Client, spans: InMemorySpanExporter
) -> None:
    unwanted, probe, wanted = Trace(spans), Trace(spans), Trace(spans)
    answer(faulty_client.post("/v1/plan", json=EASY, headers=unwanted.headers("00")))
    for path in ("/healthz", "/readyz", "/metrics"):
        assert faulty_client.get(path, headers=probe.headers()).status_code == 200
    answer(faulty_client.get("/v1/robots", headers=wanted.headers()))
    assert wanted.request().name == "GET /v1/robots"
    assert not unwanted.spans
    assert not probe.spans


def test_a_job_is_a_trace_of_its_own_with_a_link_to_its_request(
    faulty_client: httpx.Client, spans: InMemorySpanExporter
) -> None:
    trace = Trace(spans)
    path = submit(faulty_client, EASY, **trace.headers())
    assert ended(faulty_client, path)["status"] == "succeeded"
    request, identity = trace.request(), path.rpartition("/")[2]
    assert attributes(request)["armwright.job_id"] == identity

    def jobs() -> list[ReadableSpan]:
        done = spans.get_finished_spans()
        named = [span for span in done if attributes(span).get("armwright.job_id") == identity]
        return [span for span in named if span.kind is SpanKind.CONSUMER]

    assert wait_until(lambda: bool(jobs()), 20.0)
    (job,) = jobs()
    assert job.name == "job POST /v1/plan"
    assert job.parent is None
    assert trace_id(job) != trace.id
    assert [link.context for link in job.links] == [request.context]
    within = [span for span in spans.get_finished_spans() if trace_id(span) == trace_id(job)]
    # The last one is the second look at what was kept.
    worker = next(span for span in below(job, within) if below(span, within))
    names = [stage.name for stage in below(worker, within)]
    assert names[0] == "preflight"
    assert names[-1] == "certificate"


def test_wrong_traceparents_are_passed_over(
    faulty_client: httpx.Client, spans: InMemorySpanExporter
) -> None:
    for index, wrong in enumerate(["", "00-0-0-01", f"00-{'0' * 32}-{'1' * 16}-01", "é"]):
        headers = {b"traceparent": wrong.encode(), b"x-request-id": f"wrong-{index}".encode()}
        response = faulty_client.get("/v1/robots", headers=headers)
        assert response.status_code == 200, json.loads(response.content)

    def roots() -> list[ReadableSpan]:
        done = spans.get_finished_spans()
        ids = [(str(attributes(span).get("armwright.request_id")), span) for span in done]
        return [span for identity, span in ids if identity.startswith("wrong-")]

    assert wait_until(lambda: len(roots()) == 4, 20.0)
    assert all(span.parent is None for span in roots())
