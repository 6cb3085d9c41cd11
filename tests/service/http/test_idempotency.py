"""The header Idempotency-Key, without a service: what is kept, repeated, given back and refused."""

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from fastapi import Request, Response

from service.http.idempotency import answer_once
from service.http.request_headers import FIELDS, first_values
from service.problem import ProblemError
from service.storage.store import Store
from tests.service.jobs.stored import opened

CREATED = Response(
    b'{"a":1}', 201, {"Location": "/v1/scenes/a", "X-Other": "x"}, "application/json"
)


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with opened(tmp_path) as made:
        yield made


def request(
    store: Store, key: str | None, body: bytes = b"{}", method: str = "POST", path: str = "/x"
) -> Request:
    headers = [] if key is None else [(b"idempotency-key", key.encode("latin-1"))]

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": body, "more_body": False}

    app = SimpleNamespace(state=SimpleNamespace(store=store))
    scope = {
        "type": "http", "method": method, "path": path, "headers": headers, "app": app,
        "query_string": b"", "scheme": "http", "server": ("test", 80), "root_path": "",
        FIELDS: first_values({"headers": headers}),
    }  # fmt: skip
    return Request(scope, receive)


class Handler:
    """Answers with what it is given, and counts."""

    def __init__(self, response: Response | Exception = CREATED) -> None:
        self.response = response
        self.calls = 0

    async def __call__(self, request: Request) -> Response:
        self.calls += 1
        if isinstance(self.response, Exception):
            raise self.response
        return self.response


def ask(handler: Callable[[Request], Awaitable[Response]], asked: Request) -> Response:
    return asyncio.run(answer_once(asked, handler))


def code_of(handler: Handler, asked: Request) -> str:
    with pytest.raises(ProblemError) as refused:
        ask(handler, asked)
    return refused.value.code


def test_a_repeated_request_is_answered_as_the_first_one(store: Store) -> None:
    handler = Handler()
    first = ask(handler, request(store, "k"))
    again = ask(handler, request(store, "k"))
    assert handler.calls == 1
    assert (again.status_code, bytes(again.body)) == (201, bytes(first.body))
    assert again.headers["location"] == "/v1/scenes/a"
    assert again.headers["content-type"] == "application/json"
    assert again.headers["idempotency-replayed"] == "true"
    assert "idempotency-replayed" not in first.headers
    assert "x-other" not in again.headers


@pytest.mark.parametrize(("key", "method"), [(None, "POST"), ("k", "PUT"), ("k", "GET")])
def test_without_a_key_or_where_nothing_is_created_each_request_is_handled(
    store: Store, key: str | None, method: str
) -> None:
    handler = Handler()
    for _ in range(2):
        ask(handler, request(store, key, method=method))
    assert handler.calls == 2


@pytest.mark.parametrize("status", [200, 204, 400, 409, 422, 500, 503])
def test_only_what_was_created_or_accepted_is_kept(store: Store, status: int) -> None:
    handler = Handler(Response(b"", status))
    for _ in range(2):
        assert ask(handler, request(store, "k")).status_code == status
    assert handler.calls == 2
    accepted = Handler(Response(b"{}", 202))
    for _ in range(2):
        assert ask(accepted, request(store, "k")).status_code == 202
    assert accepted.calls == 1


@pytest.mark.parametrize("error", [ValueError("x"), ProblemError("INVALID_SCENE", "x")])
def test_a_request_that_fails_gives_its_key_back(store: Store, error: Exception) -> None:
    with pytest.raises(type(error)):
        ask(Handler(error), request(store, "k"))
    handler = Handler()
    assert ask(handler, request(store, "k", b"other body")).status_code == 201
    assert handler.calls == 1


def test_a_request_that_is_cancelled_gives_its_key_back(store: Store) -> None:
    async def scenario() -> None:
        async def never(request: Request) -> Response:
            await asyncio.Event().wait()
            raise AssertionError

        task = asyncio.ensure_future(answer_once(request(store, "k"), never))
        await asyncio.sleep(0.05)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert (await answer_once(request(store, "k"), Handler())).status_code == 201

    asyncio.run(scenario())


def test_a_second_request_does_not_wait_for_the_first(store: Store) -> None:
    async def scenario() -> None:
        go_on = asyncio.Event()

        async def slow(request: Request) -> Response:
            await go_on.wait()
            return CREATED

        first = asyncio.ensure_future(answer_once(request(store, "k"), slow))
        await asyncio.sleep(0.05)
        with pytest.raises(ProblemError) as conflict:
            await answer_once(request(store, "k"), slow)
        assert (conflict.value.code, conflict.value.retry_after) == ("CONFLICT", 1)
        go_on.set()
        await first
        again = await answer_once(request(store, "k"), slow)
        assert again.headers["idempotency-replayed"] == "true"

    asyncio.run(scenario())


@pytest.mark.parametrize(
    ("key", "fits"),
    [("a", True), ("x" * 255, True), ("x" * 256, False), ("", False), ("a\tb", False),
     ("é", False), ("a b", True), ("~!", True)],
)  # fmt: skip
def test_a_key_is_printable_ascii_of_some_length(store: Store, key: str, fits: bool) -> None:
    handler = Handler()
    if fits:
        ask(handler, request(store, key))
    else:
        assert code_of(handler, request(store, key)) == "VALIDATION_ERROR"
    assert handler.calls == int(fits)
