"""An agent answers for health and metrics, and for nothing else."""

import asyncio
from typing import Any

import httpx
import pytest
from fastapi import FastAPI

from service.http.layer.middleware import HEALTH_PATHS, ServiceMiddleware
from service.http.metrics import Metrics
from service.settings import Settings


def status_of(path: str) -> int:
    """The status of the answer to a path; 200 is that of the application behind."""

    async def application(_scope: Any, _receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body"})

    async def ask() -> int:
        state = FastAPI()
        layer = ServiceMiddleware(application, state, Settings(), Metrics(state), health_only=True)
        transport = httpx.ASGITransport(layer)
        async with httpx.AsyncClient(transport=transport, base_url="http://agent") as client:
            return (await client.get(path)).status_code

    return asyncio.run(ask())


@pytest.mark.parametrize("path", HEALTH_PATHS)
def test_health_and_metrics_are_answered(path: str) -> None:
    assert status_of(path) == 200


@pytest.mark.parametrize("path", ["/", "/v1/plan", "/v1/jobs", "/docs", "/healthz/x", "/metricsx"])
def test_all_else_is_not_there(path: str) -> None:
    assert status_of(path) == 404
