"""Connections to a server: which stay open, threads, and broken answers."""

import contextlib
import gzip
import socket
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

import armwright_client as ours
from armwright_client import Client


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
