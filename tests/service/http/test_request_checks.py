"""Requests as llhttp parses them behind the checks of heads: what is refused, and h11's word.

h11 is the reference: whatever passes here must mean the same to it, however it arrives in parts.
"""

import asyncio
import random
import re
from typing import Any, NamedTuple, cast

import h11
import pytest
import uvicorn
from fastapi import FastAPI
from uvicorn.server import ServerState

from service.http.layer.connection import Connection, ConnectionLimits
from service.http.layer.middleware import ServiceMiddleware
from service.http.layer.request_checks import offers_upgrade
from service.http.metrics import Metrics
from service.settings import Settings

HEAD = b"POST /a HTTP/1.1\r\nHost: x\r\n"
GET = b"GET /b HTTP/1.1\r\nHost: x\r\n\r\n"
CHUNKED = HEAD + b"Transfer-Encoding: chunked\r\n\r\n"
OFFER = b"Connection: Upgrade, HTTP2-Settings\r\nUpgrade: h2c\r\nHTTP2-Settings: AA\r\n"


class Asked(NamedTuple):
    """A request that reached the application whole."""

    method: str
    target: bytes
    headers: list[tuple[bytes, bytes]]
    body: bytes


class Wire:
    """A transport that keeps what is written and takes nothing once it is closed."""

    def __init__(self) -> None:
        self.sent = b""
        self.closed = self.paused = False

    def write(self, data: bytes) -> None:
        if not self.closed:
            self.sent += data

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        return ("127.0.0.1", 1) if name in ("peername", "sockname") else default

    def is_closing(self) -> bool:
        return self.closed

    def pause_reading(self) -> None:
        self.paused = True

    def resume_reading(self) -> None:
        self.paused = False

    def close(self) -> None:
        self.closed = True


class Served:
    """A connection with an application that tells what was asked.

    Args:
        turns: Of the event loop that an answer takes.
    """

    def __init__(self, turns: int = 0) -> None:
        self.asked: list[Asked] = []
        self._turns = turns
        state: Any = FastAPI()
        layer = ServiceMiddleware(self.app, state, Settings(), Metrics(state))
        config = uvicorn.Config(layer, log_config=None, access_log=False, interface="asgi3")
        config.load()
        limits = ConnectionLimits(10, 5.0)
        self.wire = Wire()
        self.connection = Connection(
            limits, config=config, server_state=ServerState(), app_state={}
        )
        self.connection.connection_made(cast(asyncio.Transport, self.wire))

    async def app(self, scope: Any, receive: Any, send: Any) -> None:
        body, more = b"", True
        while more:
            message = await receive()
            body, more = body + message["body"], message["more_body"]
        query = scope["query_string"]
        target = scope["raw_path"] + (b"?" + query if query else b"")
        self.asked.append(Asked(scope["method"], target, scope["headers"], body))
        for _ in range(self._turns):
            await asyncio.sleep(0)
        await send({"type": "http.response.start", "status": 200, "headers": []})
        for part in (b"<", target, b">"):
            await send({"type": "http.response.body", "body": part, "more_body": part != b">"})

    async def take(self, *parts: bytes) -> bytes:
        """What is answered to some bytes."""
        for part in parts:
            self.connection.data_received(part)
            await asyncio.sleep(0)
        quiet = 0
        while quiet < 30:
            before = len(self.wire.sent), len(self.asked)
            await asyncio.sleep(0)
            quiet = quiet + 1 if before == (len(self.wire.sent), len(self.asked)) else 0
        return self.wire.sent

    def end(self) -> None:
        self.connection.connection_lost(None)


def statuses(answer: bytes) -> list[int]:
    return [int(status) for status in re.findall(rb"HTTP/1\.1 (\d{3}) ", answer)]


def served(*parts: bytes, turns: int = 0) -> tuple[Served, bytes]:
    async def scenario() -> tuple[Served, bytes]:
        connection = Served(turns)
        sent = await connection.take(*parts)
        connection.end()
        await asyncio.sleep(0)
        return connection, sent

    return asyncio.run(scenario())


@pytest.mark.parametrize(
    "sent",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: x\r\nHost: x\r\n\r\n",
        b"GET /\r\n\r\n",
        b"GET / HTTP/0.9\r\n\r\n",
        b"GET / HTTP/2.0\r\nHost: x\r\n\r\n",
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
        b"GET http://x/ HTTP/1.1\r\nHost: x\r\n\r\n",
        b"OPTIONS * HTTP/1.1\r\nHost: x\r\n\r\n",
        b"CONNECT x:1 HTTP/1.1\r\nHost: x\r\n\r\n",
        b"GET /\xc3\xa9 HTTP/1.1\r\nHost: x\r\n\r\n",
        b"GET /?\xc3\xa9 HTTP/1.1\r\nHost: x\r\n\r\n",
        b"GET /a\tb HTTP/1.1\r\nHost: x\r\n\r\n",
        b"GET / HTTP/1.1\nHost: x\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: x\n\r\n",
        b"GET / HTTP/1.1\r\nHost: x\r\nX: a\r\n b\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: x\r\nX: a\rb\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: x\r\nX: a\x00\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: x\r\nX: a\x01\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: x\r\nX\x01: a\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: x\r\nX : a\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: x\r\n: a\r\n\r\n",
        HEAD + b"Content-Length: 1, 2\r\n\r\nabc",
        HEAD + b"Content-Length: 1\r\nContent-Length: 2\r\n\r\nabc",
        HEAD + b"Content-Length: +1\r\n\r\na",
        HEAD + b"Content-Length: -1\r\n\r\na",
        HEAD + b"Content-Length: 99999999999999999999999\r\n\r\n",
        HEAD + b"Content-Length: 3\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
        HEAD + b"Transfer-Encoding: chunked\r\nContent-Length: 3\r\n\r\n0\r\n\r\n",
        HEAD + b"Transfer-Encoding: gzip\r\n\r\n",
        HEAD + b"Transfer-Encoding: gzip, chunked\r\n\r\n0\r\n\r\n",
        HEAD + b"Transfer-Encoding: chunked, gzip\r\n\r\n0\r\n\r\n",
        HEAD + b"Transfer-Encoding: chunked\r\nTransfer-Encoding: gzip\r\n\r\n0\r\n\r\n",
        CHUNKED + b"g\r\n",
        CHUNKED + b"0x1\r\na\r\n0\r\n\r\n",
        CHUNKED + b"1\na\r\n0\r\n\r\n",
        CHUNKED + b"1\r\nab\r\n0\r\n\r\n",
        CHUNKED + b"ffffffffffffffffff\r\n",
        CHUNKED + b"-1\r\n",
        b"GET / HTTP/1.1\r\nHost: x\r\nX: " + b"x" * 80_000,
        b"GET /" + b"x" * 80_000,
        b"\r\n" * 40_000,
    ],
)
def test_refusals(sent: bytes) -> None:
    for parts in ((sent,), tuple(sent[i : i + 1000] for i in range(0, len(sent), 1000))):
        connection, answer = served(*parts)
        assert answer.startswith(b"HTTP/1.1 400 Bad Request\r\n"), answer
        assert statuses(answer) == [400]
        assert b'"INVALID_REQUEST"' in answer
        assert connection.wire.closed
        assert connection.asked == []


@pytest.mark.parametrize("begun", [b"1;", b"0\r\nX: "])
def test_what_never_ends_behind_a_head_is_refused(begun: bytes) -> None:
    connection, answer = served(CHUNKED + begun, *[b"x" * 1000] * 80)
    assert statuses(answer) == [400]
    assert (connection.asked, connection.wire.closed) == ([], True)


def test_a_head_shorter_than_the_limit_passes_byte_by_byte_or_whole() -> None:
    sent = HEAD + b"X: " + b"x" * 60_000 + b"\r\nContent-Length: 2\r\n\r\nab"
    for size in (len(sent), 997, 1):
        parts = [sent[i : i + size] for i in range(0, len(sent), size)]
        connection, _ = served(*parts)
        assert [asked.body for asked in connection.asked] == [b"ab"]


def test_trailers_do_not_pass_for_headers() -> None:
    trailer = b"1\r\na\r\n0\r\nAuthorization: Bearer stolen\r\n\r\n"
    connection, answer = served(CHUNKED + trailer + GET)
    assert [asked.body for asked in connection.asked] == [b"a", b""]
    assert all(name != b"authorization" for asked in connection.asked for name, _ in asked.headers)
    assert answer.count(b"HTTP/1.1 200") == 2


@pytest.mark.parametrize("turns", [0, 5])
@pytest.mark.parametrize("size", [1, 7, 64, 100_000])
def test_requests_sent_ahead_are_answered_in_their_order(turns: int, size: int) -> None:
    sent = b"".join(
        b"POST /%d HTTP/1.1\r\nHost: x\r\nContent-Length: 3\r\n\r\nabc" % k for k in range(400)
    )
    connection, answer = served(
        *(sent[i : i + size] for i in range(0, len(sent), size)), turns=turns
    )
    assert [asked.target for asked in connection.asked] == [b"/%d" % k for k in range(400)]
    places = [answer.index(b"/%d\r\n" % k) for k in range(400)]
    assert places == sorted(places)


@pytest.mark.parametrize("size", [1, 50, 100_000])
@pytest.mark.parametrize(
    ("framing", "body"),
    [
        (b"Content-Length: %d\r\n\r\n" % len(GET), GET),
        (b"Transfer-Encoding: chunked\r\n\r\n", b"%x\r\n%s\r\n0\r\n\r\n" % (len(GET), GET)),
    ],
)
def test_a_body_behind_an_offer_of_another_protocol_is_no_request(
    size: int, framing: bytes, body: bytes
) -> None:
    """As clients send it that would rather speak HTTP/2: the parser leaves the body unread."""
    sent = HEAD + OFFER + framing + body + GET
    connection, answer = served(*(sent[i : i + size] for i in range(0, len(sent), size)))
    assert connection.asked == []
    assert statuses(answer) == [400]
    assert b"another protocol" in answer
    assert connection.wire.closed


def test_an_offer_without_a_body_is_answered_and_ends_the_connection() -> None:
    connection, answer = served(GET[:-2] + OFFER + b"\r\n", GET)
    assert [asked.target for asked in connection.asked] == [b"/b"]
    assert b"connection: close" in answer
    assert connection.wire.closed


def reference(sent: bytes) -> list[Asked]:
    """The requests that h11 finds.

    It knows no blank lines before a request and no further blanks in its line, which RFC 9112 (2.2
    and 3) lets a server skip: they are taken out.
    """
    found = list[Asked]()
    while sent := sent.lstrip(b"\r\n"):
        connection = h11.Connection(h11.SERVER, 65536)
        connection.receive_data(re.sub(rb"^([A-Z]+) +(\S+) +", rb"\1 \2 ", sent))
        request, body = None, b""
        while not isinstance(event := next_event(connection), h11.EndOfMessage):
            if event is None or event is h11.NEED_DATA:
                return found
            if isinstance(event, h11.Request):
                request = event
            elif isinstance(event, h11.Data):
                body += event.data
        assert request is not None
        headers = [(name.lower(), value) for name, value in request.headers]
        found.append(Asked(request.method.decode(), request.target, headers, body))
        if connection.their_state is h11.MUST_CLOSE:
            return found
        sent = connection.trailing_data[0]
    return found


def next_event(connection: h11.Connection) -> object:
    try:
        return connection.next_event()
    except h11.RemoteProtocolError:
        return None


PIECES = (
    b"\r\n", b"\n", b"\r", b" ", b"\t", b":", b",", b"\x00", b"\x7f", b"\xff", b"0", b"1", b"a",
    b"Content-Length: 3\r\n", b"Transfer-Encoding: chunked\r\n", b"Connection: close\r\n", OFFER,
    b"Host: y\r\n", b"X: 1\r\n", b"\r\n\r\n", b"0\r\n\r\n", b"HTTP/1.0", b"/", b"?", GET,
)  # fmt: skip


def mutated(source: random.Random) -> bytes:
    """Some requests, most of them with a few pieces put in, taken out or doubled."""
    bodies = [b"", b"abc", GET]
    requests = list[bytes]()
    for _ in range(source.randint(1, 3)):
        body, extra = source.choice(bodies), source.choice([b"", b"", b"X: 1\r\n", OFFER])
        length = b"Content-Length: %d\r\n\r\n%s" % (len(body), body)
        chunks = b"".join(b"%x\r\n%s\r\n" % (len(part), part) for part in (body, b"z") if part)
        chunked = b"Transfer-Encoding: chunked\r\n\r\n" + chunks + b"0\r\n\r\n"
        requests.append(source.choice([HEAD + extra + length, HEAD + extra + chunked, GET]))
    sent = bytearray(b"".join(requests))
    for _ in range(source.choice([0, 1, 1, 2, 3])):
        place = source.randrange(len(sent))
        kind = source.random()
        if kind < 0.6:
            sent[place:place] = source.choice(PIECES)
        elif kind < 0.8:
            del sent[place : place + source.randint(1, 3)]
        else:
            sent[place:place] = sent[place : place + source.randint(1, 40)]
    return bytes(sent)


@pytest.mark.parametrize("seed", range(8))
def test_whatever_passes_means_the_same_to_h11(seed: int) -> None:
    source = random.Random(seed)
    passed = refused = 0
    for _ in range(250):
        sent = mutated(source)
        cuts = sorted(source.sample(range(len(sent) + 1), min(source.randint(0, 5), len(sent))))
        parts = [sent[a:b] for a, b in zip([0, *cuts], [*cuts, len(sent)], strict=True) if a < b]
        connection, answer = served(*parts, turns=source.choice([0, 3]))
        expected, found = reference(sent), connection.asked
        # What is refused may pass there: continued lines, lengths twice. Behind an offer of another
        # protocol nothing is answered, and before what is broken not all.
        codes = statuses(answer)
        is_refused = any(code != 200 for code in codes)
        is_cut = is_refused or any(offers_upgrade({"headers": a.headers}) for a in found)
        assert found == (expected[: len(found)] if is_cut else expected), sent
        assert codes == [200] * codes.count(200) + codes[-1:] * is_refused, sent
        answered = codes.count(200)
        assert answered == len(found) or (is_refused and answered < len(found)), sent
        passed += len(found)
        refused += is_refused
    assert passed > 100
    assert refused > 30
