"""Responses read by llhttp, against the standard library's: however they are cut on their way."""

import http.client
import socket
import threading
from contextlib import suppress
from random import Random
from typing import Any

import pytest

from armwright_client.connections import _Joined
from armwright_client.llhttp import ParsedResponse

OK = b"HTTP/1.1 200 OK\r\n"
EMPTY = b"content-length: 0\r\n\r\n"
TYPE = b"Content-Type: application/json\r\n"
CHUNKED = OK + TYPE + b"Transfer-Encoding: chunked\r\n\r\n"
WHOLE = {
    "length": OK + TYPE + b"Content-Length: 5\r\n\r\nhello",
    "empty": OK + EMPTY,
    "padded": OK + b"X-Padded:   a b \t\r\nContent-Length: 2\r\n\r\n{}",
    "latin": OK + b"X-Latin: caf\xe9\r\nContent-Length: 2\r\n\r\n{}",
    "twice": OK + b"Vary: a\r\nvary: b\r\nContent-Length: 2\r\n\r\n{}",
    "no content": b"HTTP/1.1 204 No Content\r\nETag: x\r\n\r\n",
    "no reason": b"HTTP/1.1 404 \r\nContent-Length: 2\r\n\r\n{}",
    "chunked": CHUNKED + b"3\r\nhel\r\n2;name=value\r\nlo\r\n0\r\n\r\n",
    "trailer": CHUNKED + b"5\r\nhello\r\n0\r\nContent-Type: text/html\r\n\r\n",
    "closing": OK + b"Connection: close\r\nContent-Length: 5\r\n\r\nhello",
    "continued": b"HTTP/1.1 100 Continue\r\nX-Early: 1\r\n\r\n" + OK + EMPTY,
    "old": b"HTTP/1.0 200 OK\r\nContent-Length: 5\r\n\r\nhello",
    "kept old": b"HTTP/1.0 200 OK\r\nConnection: keep-alive\r\nContent-Length: 5\r\n\r\nhello",
}
ENDED = {
    "until the end": OK + TYPE + b"\r\nhello, world",
    "old, until the end": b"HTTP/1.0 200 OK\r\n\r\nhello",
}
BROKEN = {
    "nothing": b"",
    "no HTTP": b"SSH-2.0-OpenSSH_9.2\r\n\r\n",
    "half a head": OK + TYPE,
    "half a body": OK + b"Content-Length: 10\r\n\r\nhello",
    "half a chunk": CHUNKED + b"a\r\nhello",
    "many fields": OK + b"X: y\r\n" * 200 + b"Content-Length: 0\r\n\r\n",
    "long head": OK + b"X: " + b"y" * 300_000 + b"\r\n\r\n",
}


def response(kind: Any, content: bytes, *, seed: int, ends: bool) -> Any:
    """A response that comes in pieces cut at random, and its body."""
    ours, theirs = socket.socketpair()

    def send() -> None:
        random, place = Random(seed), 0
        while place < len(content):
            size = random.choice((1, 3, 17, 1000, len(content)))
            with suppress(OSError):  # nobody reads the rest of what is refused
                theirs.sendall(content[place : place + size])
            place += size
        if ends:
            theirs.close()

    ours.settimeout(5.0)
    sender = threading.Thread(target=send)
    read = kind(ours, method="POST")
    try:
        sender.start()
        read.begin()
        return read, read.read()
    finally:
        read.close()
        ours.close()
        sender.join()
        theirs.close()


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_no_whole_response_is_an_error(name: str) -> None:
    for seed in range(5):
        with pytest.raises(http.client.HTTPException):
            response(ParsedResponse, BROKEN[name], seed=seed, ends=True)
    if name != "half a head":  # which the standard library takes for a whole one
        with pytest.raises(http.client.HTTPException):
            response(http.client.HTTPResponse, BROKEN[name], seed=0, ends=True)


@pytest.mark.parametrize("name", [*WHOLE, *ENDED])
def test_responses_are_those_of_the_standard_library(name: str) -> None:
    content = WHOLE.get(name) or ENDED[name]
    expected, body = response(http.client.HTTPResponse, content, seed=0, ends=name in ENDED)
    for seed in range(20):
        read, found = response(ParsedResponse, content, seed=seed, ends=name in ENDED)
        assert (read.status, found) == (expected.status, body)
        assert read.will_close == bool(expected.will_close)
        theirs = [(key.lower(), value.strip()) for key, value in expected.headers.items()]
        assert list(read.headers.items()) == theirs
        for key, _ in theirs:
            assert read.headers.get(key.upper()) == expected.headers.get(key).strip()
        assert read.headers.get("x-missing", "none") == "none"


@pytest.mark.parametrize("rest", [b"HTTP/1.1 200 OK\r\n", b"garbage"])
def test_a_connection_that_sends_more_than_was_asked_for_is_not_used_again(rest: bytes) -> None:
    for name in ("length", "chunked", "closing"):
        read, body = response(ParsedResponse, WHOLE[name] + rest, seed=4, ends=False)
        assert body == b"hello"
        assert read.will_close or not rest.startswith(b"HTTP")


def test_answers_to_head_have_no_body() -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        theirs.sendall(OK + b"Content-Length: 10\r\n\r\n")
        read = ParsedResponse(ours, method="HEAD")
        read.begin()
        assert read.read() == b""


def test_silence_is_a_timeout() -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        ours.settimeout(0.05)
        with pytest.raises(TimeoutError):
            ParsedResponse(ours).begin()


def test_connections_read_by_it_one_request_after_the_other() -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        connection = _Joined("localhost")
        connection.sock = ours
        for name in ("length", "chunked", "trailer", "length"):
            connection.request("POST", "/", b"{}")
            theirs.recv(4096)
            theirs.sendall(WHOLE[name])
            read = connection.getresponse()
            assert isinstance(read, ParsedResponse)
            assert read.read() == b"hello"
