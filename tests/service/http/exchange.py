"""Requests to a service, and the problems that it answers with."""

import json
from typing import Any

import httpx
import pytest
from fastapi import FastAPI, Request

from kinematics.errors import InvalidScene, MissingLimit
from service.http.compute import compute
from service.http.errors import KINDS
from tests.service import chores

FIELDS = {"type", "title", "status", "detail", "instance", "code", "stage", "hint", "details"}


LIMIT = 256 * 1024


BOX = {"id": "box", "shape": {"type": "box", "size": [1, 1, 1]}, "pose": {"position": [0, 0, 1]}}


def add_mishaps(app: FastAPI) -> None:
    async def stumble() -> None:
        raise RuntimeError("a secret")

    async def blame() -> None:
        raise MissingLimit("joint j1 has no acceleration limit", hint="Give it.", joint="j1")

    async def not_finite() -> None:
        raise InvalidScene(
            "x", depth=float("nan"), stage="scene", odd=object, nested=[{1: "a\ud800"}]
        )

    async def nap(request: Request) -> Any:
        return await compute(request, chores.nap.job(30.0), timeout=20.0)

    async def overrun(request: Request) -> Any:
        return await compute(request, chores.burn.job(), timeout=0.1)

    async def die(request: Request) -> Any:
        return await compute(request, chores.die.job())

    async def too_long(request: Request) -> Any:
        return await compute(request, chores.burn.job(), timeout=1e6)

    for mishap in (stumble, blame, not_finite, nap, overrun, die, too_long):
        app.router.add_api_route(f"/mishaps/{mishap.__name__}", mishap)


def problem(response: httpx.Response, status: int, code: str) -> dict[str, Any]:
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    document: dict[str, Any] = json.loads(response.content, parse_constant=pytest.fail)
    assert set(document) == FIELDS
    assert (document["status"], document["code"]) == (status, code)
    assert document["title"] == KINDS[code].title
    assert document["detail"]
    assert "Traceback" not in response.text
    return document
