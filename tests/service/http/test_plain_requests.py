"""Plain requests are answered as all others are: head, body, log and metrics."""

import asyncio
import json
import logging
import re
import socket
from collections.abc import Iterator
from typing import Any, NamedTuple, cast

import httpx
import pytest
import uvicorn
from uvicorn.server import ServerState

from service.access.authentication import Authenticator
from service.http.connection import ConnectionLimits, connection_class
from service.http.known_heads import KNOWN_HEADS
from service.http.plain_requests import PlainRequests
from service.problem import ProblemError
from service.storage.key_store import KeyStore
from tests.service.conftest import Served
from tests.service.planning import BODY
from tests.service.robots import ASIDE, HOME

PLAN = json.dumps(BODY | {"goal": {"joints": ASIDE}}).encode()
KEPT = json.dumps(BODY | {"goal": {"joints": ASIDE}, "keep": True}).encode()
#: Sent beside the others: with a header that is not usual the layers answer.
UNUSUAL = b"X-Other: 1\r\n"
#: What differs from one answer to the next.
VARIABLE = (
    rb'"milliseconds":[0-9.e\-]+', rb"date: [^\r]+", rb"x-request-id: [0-9a-f]{16}",
    rb"[0-9a-f]{32}", rb"content-length: \d+",
)  # fmt: skip


class Listening(NamedTuple):
    """A socket at which an application is served by its own connections."""

    port: int
    seen: list[str]

    def answer(self, path: str, content: bytes, *headers: bytes) -> bytes:
        """The whole answer to a request, without what differs from one to the next."""
        head = b"POST %b HTTP/1.1\r\nHost: a\r\nContent-Type: application/json\r\n" % path.encode()
        head += b"".join(headers) + b"Content-Length: %d\r\n\r\n" % len(content)
        with socket.create_connection(("127.0.0.1", self.port)) as connection:
            connection.settimeout(30.0)
            connection.sendall(head + content)
            received = b""
            while not (length := re.search(rb"content-length: (\d+)", received)):
                received += connection.recv(65536)
            end = received.index(b"\r\n\r\n") + 4 + int(length[1])
            while len(received) < end:
                received += connection.recv(65536)
        for pattern in VARIABLE:
            received = re.sub(pattern, b"", received)
        return received


@pytest.fixture
def listening(served: Served, monkeypatch: pytest.MonkeyPatch) -> Iterator[Listening]:
    """The service of all tests, at a socket of its own."""
    seen: list[str] = []

    class Noting(PlainRequests):
        async def answer(self, route: Any, *rest: Any) -> None:
            seen.append(route.path)
            await super().answer(route, *rest)

    monkeypatch.setattr(served.app.state.plain_requests, "__class__", Noting)
    config = uvicorn.Config(served.app, log_config=None, access_log=False)
    config.load()
    state, make = ServerState(), connection_class(ConnectionLimits(100, 5.0))
    state.default_headers = [(b"date", b"today")]
    loop = next(iter(served.supervisor._pool._tasks)).get_loop()

    async def begin() -> asyncio.Server:
        return await loop.create_server(
            lambda: make(config=config, server_state=state, app_state={}), "127.0.0.1", 0
        )

    server = asyncio.run_coroutine_threadsafe(begin(), loop).result()
    # Else a request every two seconds takes the way through the layers, to ask for keys.
    monkeypatch.setattr(Authenticator, "is_open", True)
    yield Listening(server.sockets[0].getsockname()[1], seen)
    loop.call_soon_threadsafe(server.close)


@pytest.mark.parametrize("path", ["/v1/plan", "/v1/check", "/v1/none"])
@pytest.mark.parametrize(
    "content",
    [
        PLAN, KEPT, b"{}", b"[]", b"null", b'"a"', b"{", b"\xff", b'{"robot": "panda"}',
        b'{"robot": "panda", "robot": "panda"}', b'{"robot": "panda", "start": NaN}',
        PLAN.replace(b"panda", b"nobody"), PLAN[:-1] + b', "scene": "nowhere"}',
        PLAN[:-1] + b', "seed": -1}', PLAN[:-1] + b', "timeout": 1e6}',
        b'{"robot": "panda", "joints": ' + json.dumps(HOME).encode() + b"}",
    ],
)  # fmt: skip
def test_they_are_answered_as_others(listening: Listening, path: str, content: bytes) -> None:
    expected = listening.answer(path, content, UNUSUAL)
    assert not listening.seen
    found = [listening.answer(path, content) for _ in range(2)]
    assert found == [expected, expected]
    assert len(listening.seen) == 2 or path == "/v1/none"


def test_a_head_that_is_known_goes_with_any_body(listening: Listening) -> None:
    for scope in (b"first_robot", b"other_robot", b"third_robot"):
        content = PLAN.replace(b"panda", scope)
        answer = listening.answer("/v1/plan", content)
        assert b"no robot named '%b'" % scope in answer
    content = PLAN.replace(b"panda", b"a_longer_robot")
    assert b"'a_longer_robot'" in listening.answer("/v1/plan", content)


def test_secrets_are_not_remembered(listening: Listening) -> None:
    listening.answer("/v1/plan", b"{}", b"Authorization: Bearer aw_a_secret\r\n")
    listening.answer("/v1/plan", b"{}", b"X-API-Key: aw_a_secret\r\n")
    listening.answer("/v1/plan", b"{}", b"X-Long: " + 2000 * b"x" + b"\r\n")
    kept = KNOWN_HEADS._heads
    assert kept
    assert not any(b"secret" in head or b"X-Long" in head for head in kept)


def test_they_are_counted_and_logged(
    listening: Listening, client: httpx.Client, caplog: pytest.LogCaptureFixture
) -> None:
    def counted() -> float:
        line = r'armwright_requests_total\{method="POST",route="/v1/plan",status="(\d+)"\} (.+)'
        return sum(float(count) for _, count in re.findall(line, client.get("/metrics").text))

    caplog.set_level(logging.INFO, "service.requests")
    before = counted()
    for content in (PLAN, b"{}"):
        for headers in ((), (UNUSUAL,)):
            listening.answer("/v1/plan", content, *headers)
    assert counted() == before + 4
    fields = [getattr(record, "fields", {}) for record in caplog.records]
    told = [(f["method"], f["status"]) for f in fields if f.get("route") == "/v1/plan"]
    assert told == [("POST", 200), ("POST", 200), ("POST", 422), ("POST", 422)]
    assert listening.seen == ["/v1/plan"] * 2


def test_it_is_known_for_a_moment_that_no_keys_are_needed() -> None:
    class Keys:
        exist = False

        def are_there_any(self) -> bool:
            return self.exist

    keys = Keys()
    authenticator = Authenticator(cast(KeyStore, keys))
    assert not authenticator.is_open, "nobody has looked"
    authenticator.authenticate({})
    assert authenticator.is_open
    with pytest.MonkeyPatch.context() as later:
        later.setattr("service.access.authentication._BELIEVED", 0.0)
        assert not authenticator.is_open
        keys.exist = True
        with pytest.raises(ProblemError):
            authenticator.authenticate({})
    assert not authenticator.is_open


@pytest.mark.parametrize(
    "header",
    [
        b"Accept-Encoding: gzip", b"Prefer: respond-async", b"X-Request-Id: mine",
        b"Origin: http://a", b"Idempotency-Key: 1", b"X-Forwarded-For: 10.0.0.1",
        b"Authorization: Bearer a", b"traceparent: 1",
    ],
)  # fmt: skip
def test_other_headers_are_for_the_layers(listening: Listening, header: bytes) -> None:
    listening.answer("/v1/plan", b"{}", header + b"\r\n")
    assert not listening.seen
