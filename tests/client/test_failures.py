"""Connections and failures that the client reports."""

import asyncio
import contextlib
import gzip
import socket
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import httpx
import pytest

import armwright_client as ours
from armwright_client import AsyncClient, Client
from tests.client.scripted import URL, Scripted, asked_async, once, problem


def test_a_problem_is_raised_as_its_class() -> None:
    answer = problem(
        422,
        "START_STATE_IN_COLLISION",
        detail="hand penetrates shelf",
        details={"pair": ["hand", "shelf"], "depth": 0.01},
        from_the_future=1,
    )
    with pytest.raises(ours.StartStateInCollision, match="hand penetrates shelf") as caught:
        once([answer], lambda client: client.plan("r", [0.0], [1.0]))
    assert caught.value.pair == ("hand", "shelf")
    assert caught.value.problem.type == "/v1/problems/START_STATE_IN_COLLISION"


def test_a_problem_of_somebody_else_is_an_api_error() -> None:
    media = {"content-type": "application/problem+json; charset=utf-8"}
    answer = httpx.Response(403, json={"title": "Forbidden by policy"}, headers=media)
    with pytest.raises(ours.ApiError, match="Forbidden by policy") as caught:
        once([answer], lambda client: client.healthz())
    assert type(caught.value) is ours.ApiError


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (httpx.Response(502, html="<html>Bad gateway</html>"), "502 Bad Gateway by something"),
        (httpx.Response(503, text="no upstream", headers={"Retry-After": "99"}), "no upstream"),
        (httpx.Response(404, json={"message": "no route"}), "no route"),
        (httpx.Response(500, json=["?"]), "not an Armwright service"),
        (httpx.Response(502), "not an Armwright service"),
        (
            httpx.Response(502, content=b"{", headers={"content-type": "application/problem+json"}),
            "not an Armwright service",
        ),
        (httpx.Response(302, headers={"Location": "https://login"}), "302 Found to https://login"),
        (httpx.Response(200, html="<html>Welcome</html>"), "something else than Health"),
        (httpx.Response(200, json={"state": "ok"}), r"something else than Health \(status:"),
        (httpx.Response(200), "something else than Health"),
    ],
)
def test_what_is_not_the_services_is_told(answer: httpx.Response, words: str) -> None:
    with pytest.raises(ours.UnexpectedAnswer, match=words) as caught:
        once([answer], lambda client: client.healthz())
    assert caught.value.status == answer.status_code
    assert "GET /healthz" in str(caught.value)
    assert len(str(caught.value)) < 500


def test_long_pages_are_cut() -> None:
    with pytest.raises(ours.UnexpectedAnswer) as caught:
        once([httpx.Response(502, text="x" * 10**6)], lambda client: client.healthz())
    assert len(caught.value.excerpt) == 200


def below(kind: type[httpx.RequestError]) -> Iterator[type[httpx.RequestError]]:
    for child in kind.__subclasses__():
        yield child
        yield from below(child)


KINDS_OF_HTTPX = list(below(httpx.RequestError))


@pytest.mark.parametrize("kind", KINDS_OF_HTTPX)
def test_no_exception_of_httpx_leaks(kind: type[httpx.RequestError]) -> None:
    for text in ("it broke", ""):
        with pytest.raises(ours.TransportError, match=kind.__name__) as caught:
            once([kind(text)], lambda client: client.healthz())
        timed_out = isinstance(caught.value, ours.TransportTimeout)
        assert timed_out == issubclass(kind, httpx.TimeoutException)
        with pytest.raises(ours.TransportError):
            asyncio.run(asked_async(Scripted([kind(text)]), lambda client: client.healthz()))


def test_an_answer_that_can_not_be_unpacked_is_told() -> None:
    body = gzip.compress(b"{}")[:-8] + b"????????"

    class Broken(httpx.SyncByteStream):
        def __iter__(self) -> Iterator[bytes]:
            yield b"not gzip" + body

    answer = httpx.Response(200, stream=Broken(), headers={"content-encoding": "gzip"})
    with pytest.raises(ours.TransportError, match="DecodingError"):
        once([answer], lambda client: client.healthz())


def test_nobody_listens() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with (
        Client(f"http://127.0.0.1:{port}") as client,
        pytest.raises(ours.TransportError, match="GET /healthz: ConnectError"),
    ):
        client.healthz()


@contextlib.contextmanager
def mute() -> Iterator[str]:
    """A server that takes connections and says nothing."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield f"http://127.0.0.1:{listener.getsockname()[1]}"


def test_nobody_answers() -> None:
    async def ask(url: str) -> None:
        async with AsyncClient(url, timeout=0.2) as client:
            await client.healthz()

    with mute() as url:
        with (
            Client(url, timeout=0.2) as client,
            pytest.raises(ours.TransportTimeout, match="GET /healthz: ReadTimeout"),
        ):
            client.healthz()
        with pytest.raises(ours.TransportTimeout):
            asyncio.run(ask(url))


def test_a_closed_client_says_so() -> None:
    client = Client(URL)
    client.close()
    with pytest.raises(ours.TransportError, match="the client is closed"):
        client.healthz()

    async def ask() -> None:
        client = AsyncClient(URL)
        await client.close()
        await client.healthz()

    with pytest.raises(ours.TransportError, match="the client is closed"):
        asyncio.run(ask())


@dataclass
class Seen:
    """The connections that a server took."""

    url: str = ""
    clients: set[Any] = field(default_factory=set)


@contextlib.contextmanager
def server() -> Iterator[Seen]:
    """A server that says compressed that it is well, and leaves its connections open."""
    seen = Seen()

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:
            seen.clients.add(self.client_address)
            content = gzip.compress(b'{"status": "ok", "version": "9.9"}')
            self.send_response(200)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Encoding", "gzip")
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_: Any) -> None:
            """Say nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as running:
        running.daemon_threads = True
        seen.url = f"http://127.0.0.1:{running.server_address[1]}"
        threading.Thread(target=running.serve_forever, daemon=True).start()
        try:
            yield seen
        finally:
            running.shutdown()


@contextlib.contextmanager
def saying(content: bytes, reads: int = 1000) -> Iterator[str]:
    """A server that reads so many bytes of one request, says something and hangs up."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def answer() -> None:
            with listener.accept()[0] as connection:
                connection.recv(reads)
                connection.sendall(content)

        threading.Thread(target=answer, daemon=True).start()
        yield f"http://127.0.0.1:{listener.getsockname()[1]}"


def test_connections_stay_open_and_threads_share_them() -> None:
    with server() as seen, Client(seen.url, compress=True) as client:
        for _ in range(3):
            client.healthz()
        assert len(seen.clients) == 1
        with ThreadPoolExecutor(8) as threads:
            answers = list(threads.map(lambda _: client.healthz().version, range(64)))
    assert answers == 64 * ["9.9"]
    assert len(seen.clients) <= 8


@pytest.mark.parametrize("content", [b"", b"hello\r\n\r\n", b"HTTP/1.1 200 OK\r\nContent-Le"])
def test_what_is_no_whole_response_is_told(content: bytes) -> None:
    with (
        saying(content) as url,
        Client(url) as client,
        pytest.raises(ours.TransportError, match="GET /healthz: RemoteProtocolError"),
    ):
        client.healthz()


def test_an_answer_before_the_body_was_sent_is_read() -> None:
    refusal = b'{"code":"PAYLOAD_TOO_LARGE","detail":"too much"}'
    head = b"HTTP/1.1 413 Too Large\r\nContent-Type: application/problem+json\r\n"
    length = b"Content-Length: %d\r\n\r\n" % len(refusal)
    listener = socket.create_server(("127.0.0.1", 0))

    def refuse() -> None:
        connection, _ = listener.accept()
        connection.recv(1000)
        connection.sendall(head + length + refusal)
        connection.shutdown(socket.SHUT_WR)
        while connection.recv(100_000):
            pass
        connection.close()

    threading.Thread(target=refuse, daemon=True).start()
    with (
        listener,
        Client(f"http://127.0.0.1:{listener.getsockname()[1]}") as client,
        pytest.raises(ours.PayloadTooLarge, match="too much"),
    ):
        client.scenes.create(ours.Scene(name="s", moveit="s" * 3_000_000))


def test_certificates_are_checked() -> None:
    with (
        server() as seen,
        Client(seen.url.replace("http://", "https://")) as client,
        pytest.raises(ours.TransportError, match="ConnectError"),
    ):
        client.healthz()
