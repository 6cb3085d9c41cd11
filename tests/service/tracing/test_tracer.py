"""Spans on their way to a collector."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from socket import create_server

import pytest
from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import ExportTraceServiceRequest

from service.tracing.extra import traces_url
from service.tracing.tracer import Tracing, http_exporter
from tests.service.processes import wait_until
from tests.times import quickest


@contextmanager
def collector() -> Iterator[tuple[str, list[tuple[str, ExportTraceServiceRequest]]]]:
    """A collector on this machine, and what it was sent: paths and messages."""
    received: list[tuple[str, ExportTraceServiceRequest]] = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            content = self.rfile.read(int(self.headers["Content-Length"]))
            received.append((self.path, ExportTraceServiceRequest.FromString(content)))
            self.send_response(200)
            self.end_headers()

        def log_message(self, *args: object) -> None:
            """Say nothing."""

    server = HTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}", received
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@pytest.mark.parametrize("name", ["armwright", "cell-7"])
def test_a_collector_receives_spans_by_otlp(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if name != "armwright":
        monkeypatch.setenv("OTEL_SERVICE_NAME", name)
    with collector() as (address, received):
        tracing = Tracing(http_exporter(traces_url(address)))
        trace = tracing.watch("service.endpoints.plan.task:plan")
        assert trace is not None
        trace.begins()
        for stage in ("preflight", "preflight", "timing", "pick up: the bolt"):
            trace.reaches(stage)
        trace.waits()
        trace.begins()
        trace.ends("CRASH")
        tracing.close()
        assert wait_until(lambda: bool(received), 10.0), "spans arrive though the machine is busy"
    ((path, message),) = received
    assert path == "/v1/traces"
    (resource,) = message.resource_spans
    told = {pair.key: pair.value.string_value for pair in resource.resource.attributes}
    assert told["service.name"] == name
    (scope,) = resource.scope_spans
    names = [span.name for span in sorted(scope.spans, key=lambda span: span.start_time_unix_nano)]
    assert names == ["queue", "worker", "preflight", "timing", "stage", "queue", "worker"]
    assert [span.status.code for span in scope.spans if span.name == "worker"] == [0, 2]
    spans = {span.span_id: span for span in scope.spans}
    for span in scope.spans:
        parent = spans.get(span.parent_span_id)
        assert (span.name in {"queue", "worker"}) == (parent is None)
        assert parent is None or parent.name == "worker"


def test_a_silent_collector_does_not_keep_the_service_from_ending() -> None:
    def attempt() -> float:
        with create_server(("127.0.0.1", 0)) as silent:
            tracing = Tracing(http_exporter(f"http://127.0.0.1:{silent.getsockname()[1]}/x"))
            trace = tracing.watch("module:task")
            assert trace is not None
            trace.ends("cancelled")
            began = time.monotonic()
            tracing.close(0.2)
            return time.monotonic() - began

    assert 0.15 < quickest(attempt, 1.0) < 1.0
