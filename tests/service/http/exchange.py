"""Paths of a service that fail in every way."""

from typing import Any

from fastapi import FastAPI, Request

from kinematics.errors import InvalidScene, MissingLimit
from service.http.compute import compute
from tests.service import chores

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
