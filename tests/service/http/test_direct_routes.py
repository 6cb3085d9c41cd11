"""Routes that are given their requests at once answer as they do behind the framework."""

import asyncio
from typing import Any

import httpx
import pytest
from fastapi import APIRouter, FastAPI, Request, Response

from armwright_wire.kinematics import FkRequest
from kinematics.errors import InvalidScene
from service.http import handlers
from service.http.direct_routes import DirectRoutes
from service.http.json_route import JsonRoute
from service.problem import ProblemError

router = APIRouter(prefix="/v1", route_class=JsonRoute)


@router.post("/echo")
async def echo(body: FkRequest, request: Request) -> Response:
    route = request.scope["route"].path
    return Response(f"{body.joints} {route} {request.url.path}", media_type="text/plain")


@router.post("/fail")
async def fail(body: FkRequest, request: Request) -> Response:
    assert request.method == "POST"
    if body.link is not None:
        raise InvalidScene("no such link", stage="scene")
    raise ProblemError("NOT_FOUND", "nothing there", stage="storage")


@router.post("/named/{name}")
async def named(name: str, body: FkRequest, request: Request) -> Response:
    return Response(f"{name} {body.joints} {request.method}")


def application(*, direct: bool) -> FastAPI:
    app = FastAPI()
    if direct:
        app.add_middleware(DirectRoutes, application=app)
    handlers.install(app)
    app.include_router(router)
    return app


DIRECT, USUAL = application(direct=True), application(direct=False)


def answer(app: FastAPI, method: str, path: str, **request: Any) -> httpx.Response:
    async def ask() -> httpx.Response:
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url="http://a") as client:
            return await client.request(method, path, **request)

    return asyncio.run(ask())


def test_routes_that_take_a_body_alone_are_direct() -> None:
    direct = {
        route.path
        for route in router.routes
        if isinstance(route, JsonRoute) and route.handle_directly is not None
    }
    assert direct == {"/v1/echo", "/v1/fail"}


@pytest.mark.parametrize("path", ["/v1/echo", "/v1/fail", "/v1/named/a", "/v1/echo/", "/v1/none"])
@pytest.mark.parametrize(
    "content",
    [
        b'{"joints": [1.0, 2.0]}', b'{"joints": [1.0], "link": "a"}', b"null", b"[]", b"1", b"{}",
        b"", b"{", b'{"joints": "a"}', b'{"joints": [1.0], "joints": [2.0]}', b'{"joints": [NaN]}',
        b'{"joints": [1.0], "other": 1}', b'"a"', b"\xff", b'{"joints": [["a"], [true]]}',
    ],
)  # fmt: skip
def test_they_answer_as_behind_the_framework(path: str, content: bytes) -> None:
    for kind in ("application/json", "application/json; charset=utf-8", "text/plain", None):
        headers = {} if kind is None else {"content-type": kind}
        mine = answer(DIRECT, "POST", path, content=content, headers=headers)
        theirs = answer(USUAL, "POST", path, content=content, headers=headers)
        assert (mine.status_code, mine.content) == (theirs.status_code, theirs.content)
        assert mine.headers == theirs.headers
    assert answer(DIRECT, "GET", path).content == answer(USUAL, "GET", path).content
