"""The extra `telemetry`: traces where they are asked for, and nothing where they are not."""

from typing import TYPE_CHECKING

from fastapi import FastAPI

if TYPE_CHECKING:
    from service.tracing.tracer import Tracing

#: Path of OTLP over HTTP at which collectors take traces.
_TRACES_PATH = "/v1/traces"


class TelemetryMissing(Exception):
    """Traces are asked for, and the packages that write them are not installed."""

    def __init__(self) -> None:
        super().__init__(
            "traces need the extra `telemetry`: pip install 'armwright[telemetry]', or leave "
            "ARMWRIGHT_TRACES out"
        )


def open_tracing(endpoint: str | None) -> "Tracing | None":
    """Tracing that sends to a collector; None without one.

    Args:
        endpoint: URL of the collector; without a path it gets the usual one.

    Raises:
        TelemetryMissing: The packages are not installed.
    """
    if endpoint is None:
        return None
    require_telemetry(endpoint)
    from service.tracing.tracer import Tracing, http_exporter  # noqa: PLC0415

    return Tracing(http_exporter(traces_url(endpoint)))


def require_telemetry(endpoint: str | None) -> None:
    """Check that traces can be written, if they are asked for.

    Raises:
        TelemetryMissing: The packages are not installed.
    """
    if endpoint is None:
        return
    try:
        import opentelemetry.exporter.otlp.proto.http.trace_exporter  # noqa: PLC0415
        import opentelemetry.sdk.trace  # noqa: F401, PLC0415
    except ImportError:
        raise TelemetryMissing from None


def install_tracing(app: FastAPI, tracing: "Tracing") -> None:
    """Put the layer that makes spans of requests around an application, outside of all others."""
    from service.tracing.tracer import Traced  # noqa: PLC0415

    app.add_middleware(Traced, tracing=tracing)


def traces_url(endpoint: str) -> str:
    """The URL that traces are sent to: an endpoint without a path gets that of OTLP."""
    _, _, rest = endpoint.partition("://")
    _, _, path = rest.partition("/")
    return endpoint if path else endpoint.rstrip("/") + _TRACES_PATH
