"""A service that answers what it was told to, for what a real one does rarely."""

from collections.abc import Callable, Iterable
from types import ModuleType, SimpleNamespace
from typing import Any

import httpx
import pytest

from armwright_client import AsyncClient, Client

URL = "http://robots.example"


Answer = httpx.Response | Exception


class Scripted(httpx.BaseTransport, httpx.AsyncBaseTransport):
    """Gives the answers in order, and keeps the requests."""

    def __init__(self, answers: Iterable[Answer]) -> None:
        self._answers = list(answers)
        self.requests: list[httpx.Request] = []

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        request.read()
        return self._next(request)

    async def handle_async_request(self, request: httpx.Request) -> httpx.Response:
        await request.aread()
        return self._next(request)

    def _next(self, request: httpx.Request) -> httpx.Response:
        self.requests.append(request)
        answer = self._answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer


def health() -> httpx.Response:
    return httpx.Response(200, json={"status": "ok", "version": "9.9"})


def problem(
    status: int, code: str, headers: dict[str, str] | None = None, **fields: object
) -> httpx.Response:
    document = {"type": f"/v1/problems/{code}", "title": "t", "status": status, "code": code}
    return httpx.Response(
        status,
        json=document | fields,
        headers={"content-type": "application/problem+json"} | (headers or {}),
    )


def once(answers: list[Answer], ask: Callable[[Client], Any], **options: Any) -> Any:
    """Ask a scripted service by `Client`; and the same by `AsyncClient`, for the same answer."""
    with Client(URL, transport=Scripted(list(answers)), **options) as client:
        return ask(client)


async def asked_async(transport: Scripted, ask: Callable[[AsyncClient], Any]) -> httpx.Request:
    async with AsyncClient(URL, transport=transport) as client:
        await ask(client)
    return transport.requests[-1]


def noted_pauses(monkeypatch: pytest.MonkeyPatch, module: ModuleType) -> list[float]:
    """The pauses that a module makes from now on: its clock goes on by them, and nobody waits.

    Only this module's: servers of other tests may run in threads of this process, and need theirs.
    """
    made: list[float] = []

    async def note(seconds: float) -> None:
        made.append(seconds)

    clock = SimpleNamespace(sleep=made.append, monotonic=lambda: 1000.0 + sum(made))
    monkeypatch.setattr(module, "time", clock)
    monkeypatch.setattr(module, "asyncio", SimpleNamespace(sleep=note))
    return made
