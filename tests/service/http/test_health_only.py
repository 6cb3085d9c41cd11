"""An agent answers for health and metrics, and for nothing else."""

import asyncio
from typing import Any

import pytest

from service.http.health_only import PATHS, HealthOnly


def status_of(path: str, kind: str = "http") -> int:
    """The status of the answer to a path; 200 is that of the application behind."""
    statuses = []

    async def application(_scope: Any, _receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def send(message: Any) -> None:
        statuses.append(message.get("status"))

    scope = {"type": kind, "path": path, "method": "GET", "headers": []}
    asyncio.run(HealthOnly(application)(scope, None, send))  # type: ignore[arg-type]
    return int(statuses[0])


@pytest.mark.parametrize("path", PATHS)
def test_health_and_metrics_are_answered(path: str) -> None:
    assert status_of(path) == 200


@pytest.mark.parametrize("path", ["/", "/v1/plan", "/v1/jobs", "/docs", "/healthz/x", "/metricsx"])
def test_all_else_is_not_there(path: str) -> None:
    assert status_of(path) == 404


def test_the_start_and_the_end_of_the_application_go_through() -> None:
    assert status_of("/v1/plan", kind="lifespan") == 200
