"""Simple requests: read as h11 reads them, and answered so that h11 reads the answer."""

import asyncio
import logging
from typing import Any

import h11
import pytest
from hypothesis import given
from hypothesis import strategies as st
from uvicorn.protocols.http.flow_control import FlowControl

from service.http.simple_cycle import BODY_BYTES, SimpleCycle, read_head

REQUEST = b"POST /v1/plan HTTP/1.1\r\nHost: localhost:8000\r\nContent-Length: 2\r\n\r\n{}"
#: Lines that real heads have, and those that are told apart only with care.
LINES = [
    b"Host: a", b"host: b.example:80", b"Host:a", b"Host : a", b" folded", b"Content-Length: 2",
    b"content-length: 2", b"Content-Length: 3", b"Content-Length: +2", b"Content-Length: 2, 2",
    b"Content-Length: 02", b"Content-Length: 2 ", b"Transfer-Encoding: chunked", b"TE: trailers",
    b"Expect: 100-continue", b"Upgrade: websocket", b"Connection: close",
    b"Connection: keep-alive", b"Connection: Keep-Alive, X-Secret", b"Accept: */*",
    b"Accept-Encoding: gzip, deflate", b"User-Agent: a  b", b"X: \xff", b"X: a\nHost: c", b"X:",
    b"X: a\rb", b"X-Request-Id: 1\x00", b": a", b"Content-Type: application/json", b"a" * 9000,
]  # fmt: skip
FIRST = [
    b"POST /v1/plan HTTP/1.1", b"POST /v1/plan HTTP/1.0", b"POST /v1/plan?a=b HTTP/1.1",
    b"post /v1/plan HTTP/1.1", b"POST /v1/a%2fb HTTP/1.1", b"POST http://a/v1/plan HTTP/1.1",
    b"GET /v1/plan HTTP/1.1", b"POST  /v1/plan HTTP/1.1", b"POST /v1/robots/a/ik HTTP/1.1",
]  # fmt: skip


def read_by_h11(data: bytes) -> tuple[h11.Request, bytes]:
    connection = h11.Connection(h11.SERVER)
    connection.receive_data(data)
    request = connection.next_event()
    assert isinstance(request, h11.Request)
    body = b""
    while isinstance(event := connection.next_event(), h11.Data):
        body += event.data
    assert isinstance(event, h11.EndOfMessage)
    return request, body


def check_against_h11(data: bytes) -> bool:
    """Whether a request is simple; if it is, h11 must read the same."""
    head = read_head(data)
    if head is None:
        return False
    request, body = read_by_h11(data[: head.body_at + head.size])
    assert (request.method, request.target) == (b"POST", head.path.encode())
    assert (list(request.headers), request.http_version) == (head.fields, b"1.1")
    assert body == data[head.body_at : head.body_at + head.size]
    return True


def test_a_post_with_a_length_is_simple() -> None:
    assert check_against_h11(REQUEST)
    assert not check_against_h11(REQUEST[:60])
    assert not check_against_h11(REQUEST.replace(b": 2", b": %d" % (BODY_BYTES + 1)))


@pytest.mark.parametrize("line", LINES)
@pytest.mark.parametrize("first", FIRST)
def test_no_line_is_read_otherwise_than_by_h11(first: bytes, line: bytes) -> None:
    for lines in ([b"Host: a", b"Content-Length: 2"], [b"Host: a"], [b"Content-Length: 2"]):
        check_against_h11(b"\r\n".join([first, *lines, line, b"", b"{} "]))


@given(st.lists(st.sampled_from(LINES), max_size=6), st.sampled_from(FIRST[:2]))
def test_no_head_is_read_otherwise_than_by_h11(lines: list[bytes], first: bytes) -> None:
    check_against_h11(b"\r\n".join([first, *lines, b"", b"{} "]))


@given(st.binary(max_size=30), st.integers(0, len(REQUEST) - 2), st.integers(0, 10))
def test_no_bytes_are_read_otherwise_than_by_h11(put: bytes, at: int, dropped: int) -> None:
    check_against_h11(REQUEST[:at] + put + REQUEST[at + dropped :])


class Pipe(asyncio.Transport):
    """A transport that keeps what is written."""

    def __init__(self) -> None:
        super().__init__()
        self.written, self.is_closed = b"", False

    def write(self, data: bytes | bytearray | memoryview) -> None:
        self.written += bytes(data)

    def close(self) -> None:
        self.is_closed = True


def answer(messages: list[Any], **attributes: Any) -> Pipe:
    """What goes out for an answer."""
    transport = Pipe()

    async def run() -> None:
        log = logging.getLogger("test")
        scope: Any = {"method": "POST", "headers": []}
        cycle = SimpleCycle(
            scope, h11.Connection(h11.SERVER), transport, FlowControl(transport), log, log, False,
            [(b"date", b"today")], asyncio.Event(), lambda: None,
        )  # fmt: skip
        for name, value in attributes.items():
            setattr(cycle, name, value)
        for message in messages:
            await cycle.send(message)

    asyncio.run(run())
    return transport


def start(status: int = 200, *headers: tuple[bytes, bytes]) -> dict[str, Any]:
    return {"type": "http.response.start", "status": status, "headers": list(headers)}


def part(body: bytes, *, more: bool = False) -> dict[str, Any]:
    return {"type": "http.response.body", "body": body, "more_body": more}


@pytest.mark.parametrize(
    ("messages", "status", "body"),
    [
        ([start(200, (b"content-length", b"3")), part(b"abc")], 200, b"abc"),
        ([start(), part(b"ab", more=True), part(b"", more=True), part(b"c")], 200, b"abc"),
        ([start(), part(b"")], 200, b""),
        ([start(204), part(b"")], 204, b""),
        ([start(429, (b"content-length", b"0"), (b"retry-after", b"1")), part(b"")], 429, b""),
        ([start(200, (b"content-length", b"600000")), part(600_000 * b"x")], 200, 600_000 * b"x"),
    ],
)
def test_h11_reads_the_answer(messages: list[Any], status: int, body: bytes) -> None:
    sent = answer(messages)
    client = h11.Connection(h11.CLIENT)
    client.send(h11.Request(method="POST", target="/", headers=[("host", "a")]))
    client.send(h11.EndOfMessage())
    client.receive_data(sent.written)
    response, read = client.next_event(), b""
    assert isinstance(response, h11.Response)
    assert (response.status_code, dict(response.headers)[b"date"]) == (status, b"today")
    while isinstance(event := client.next_event(), h11.Data):
        read += event.data
    assert isinstance(event, h11.EndOfMessage)
    assert (read, client.trailing_data[0], sent.is_closed) == (body, b"", False)


def test_the_last_answer_of_a_connection_says_so() -> None:
    ending = answer([start(200, (b"content-length", b"0")), part(b"")], keep_alive=False)
    assert b"\r\nconnection: close\r\n" in ending.written
    assert ending.is_closed
    refused = [start(413, (b"content-length", b"0"), (b"Connection", b"close")), part(b"")]
    assert answer(refused).is_closed


@pytest.mark.parametrize(
    "messages",
    [
        [part(b"a"), start()],
        [start(), start()],
        [start(200, (b"location", b"/a\r\nx: y"))],
        [start(200, (b"location", b"/a\nx: y"))],
        [start(200, (b"content-length", b"0")), part(b""), part(b"a")],
    ],
)
def test_what_is_no_answer_is_not_sent(messages: list[Any]) -> None:
    with pytest.raises(RuntimeError, match=r"not due|line break"):
        answer(messages)
