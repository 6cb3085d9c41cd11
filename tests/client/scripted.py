"""A service that answers what it was told to, for what a real one does rarely."""

from collections.abc import Iterable

import httpx

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
