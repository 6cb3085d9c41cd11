"""Connections straight to a service: errors, threads, what is kept open, and the same answers."""

import contextlib
import gzip
import http.client
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import httpx
import pytest

import armwright_client as ours
from armwright_client import Client, connections
from armwright_client.connections import Connections, direct

LIMITS = httpx.Timeout(5.0, connect=5.0)
HEALTH = b'{"status": "ok", "version": "9.9"}'


@dataclass
class Seen:
    """What a server saw, and how it ends its answers."""

    url: str = ""
    clients: set[Any] = field(default_factory=set)
    asked: list[tuple[str, str, dict[str, str], bytes]] = field(default_factory=list)
    closes: bool = False
    status: int = 200
    headers: dict[str, str] = field(default_factory=lambda: {"Content-Type": "application/json"})
    content: bytes = HEALTH


@contextlib.contextmanager
def server() -> Iterator[Seen]:
    """A server that says it is well, and keeps its connections open."""
    seen = Seen()

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:
            content = self.rfile.read(int(self.headers.get("Content-Length", "0")))
            seen.clients.add(self.client_address)
            seen.asked.append((self.command, self.path, dict(self.headers), content))
            self.send_response(seen.status)
            for name, value in seen.headers.items():
                self.send_header(name, value)
            self.send_header("Content-Length", str(len(seen.content)))
            if seen.closes:
                self.send_header("Connection", "close")
            self.end_headers()
            self.wfile.write(seen.content)

        do_POST = do_GET

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


def test_the_same_goes_over_the_wire_as_by_httpx() -> None:
    with server() as seen:
        for transport in (None, httpx.HTTPTransport()):
            with Client(f"{seen.url}/arms/", token="t", transport=transport) as client:
                assert client.healthz().version == "9.9"
                with contextlib.suppress(ours.UnexpectedAnswer):
                    client.scenes.create(ours.Scene(name="s é", obstacles=[]))
    plain = [
        (method, path, {k.lower(): v for k, v in headers.items()}, content)
        for method, path, headers, content in seen.asked
    ]
    assert plain[:2] == plain[2:]
    assert [path for _, path, *_ in plain[:2]] == ["/arms/healthz", "/arms/v1/scenes"]


def test_a_connection_is_kept_while_it_is_fresh_and_open(monkeypatch: pytest.MonkeyPatch) -> None:
    with server() as seen, Client(seen.url) as client:
        for _ in range(3):
            client.healthz()
        assert len(seen.clients) == 1
        monkeypatch.setattr(connections, "_IDLE", -1.0)
        client.healthz()
        assert len(seen.clients) == 2
        monkeypatch.undo()
        seen.closes = True
        for _ in range(3):
            client.healthz()
        assert len(seen.clients) == 4


@pytest.mark.parametrize(
    ("status", "headers", "content"),
    [
        (404, {"Content-Type": "application/problem+json"}, b'{"code":"NOT_FOUND","detail":"no"}'),
        (429, {"content-type": "application/problem+json", "RETRY-AFTER": "99"}, b'{"code":"X"}'),
        (502, {"Content-Type": "text/html; charset=latin-1"}, "<p>gestört</p>".encode("latin-1")),
        (
            502,
            {"Content-Type": "text/html", "Content-Encoding": "gzip"},
            gzip.compress(b"<p>!", mtime=0),
        ),
        (302, {"Location": "https://login"}, b""),
        (200, {"Content-Type": "text/html"}, "<p>Grüße \xff".encode("latin-1")),
    ],
)
def test_refusals_are_told_as_by_httpx(
    status: int, headers: dict[str, str], content: bytes
) -> None:
    told = []
    with server() as seen:
        seen.status, seen.headers, seen.content = status, headers, content
        for transport in (None, httpx.HTTPTransport()):
            with (
                Client(seen.url, transport=transport) as client,
                pytest.raises(ours.ArmwrightError) as refused,
            ):
                client.healthz()
            told.append((type(refused.value), str(refused.value), vars(refused.value)))
    assert told[0] == told[1]


def test_threads_share_them() -> None:
    with server() as seen, Client(seen.url) as client, ThreadPoolExecutor(8) as threads:
        answers = list(threads.map(lambda _: client.healthz().version, range(64)))
    assert answers == 64 * ["9.9"]
    assert len(seen.clients) <= 8


def test_what_hangs_up_is_told() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def hang_up() -> None:
            listener.accept()[0].close()

        threading.Thread(target=hang_up, daemon=True).start()
        with (
            Client(f"http://127.0.0.1:{listener.getsockname()[1]}") as client,
            pytest.raises(ours.TransportError, match="GET /healthz: "),
        ):
            client.healthz()


def test_an_answer_before_the_body_was_sent_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    original = http.client.HTTPConnection.send

    def break_off(connection: Any, data: Any) -> None:
        original(connection, data)
        raise BrokenPipeError

    monkeypatch.setattr(http.client.HTTPConnection, "send", break_off)
    with server() as seen:
        seen.status, seen.content = 413, b"too much"
        received = Connections(seen.url).send("POST", "/v1/plan", {}, b"{}", LIMITS)
    assert (received.status_code, received.content) == (413, b"too much")


def test_a_host_that_is_not_there_and_one_that_hangs_are_told() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        patience = httpx.Timeout(0.05, connect=5.0)
        with pytest.raises(httpx.ReadTimeout):
            Connections(f"http://127.0.0.1:{port}").send("GET", "/healthz", {}, None, patience)
    with pytest.raises(httpx.ConnectError):
        Connections(f"http://127.0.0.1:{port}").send("GET", "/healthz", {}, None, LIMITS)


def test_what_is_not_http_is_told() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def answer() -> None:
            with listener.accept()[0] as connection:
                connection.recv(1000)
                connection.sendall(b"hello\r\n\r\n")

        threading.Thread(target=answer, daemon=True).start()
        url = f"http://127.0.0.1:{listener.getsockname()[1]}"
        with pytest.raises(httpx.RemoteProtocolError):
            Connections(url).send("GET", "/healthz", {}, None, LIMITS)


def test_compressed_answers_are_unpacked() -> None:
    with server() as seen:
        seen.headers["Content-Encoding"] = "gzip"
        seen.content = gzip.compress(HEALTH)
        with Client(seen.url, compress=True) as client:
            assert client.healthz().version == "9.9"


def test_certificates_are_checked() -> None:
    with server() as seen:
        secure = Connections(seen.url.replace("http://", "https://"))
        with pytest.raises(httpx.ConnectError):
            secure.send("GET", "/healthz", {}, None, LIMITS)


def test_proxies_and_transports_are_left_to_httpx(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("http_proxy", "https_proxy", "all_proxy"):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.upper(), raising=False)
    assert direct("http://host", None) is not None
    assert direct("http://host", httpx.HTTPTransport()) is None
    monkeypatch.setenv("http_proxy", "http://proxy:3128")
    assert direct("http://host", None) is None


@pytest.mark.parametrize("size", [0, 1, 1000, 65_000, 65_536, 70_000, 3_000_000])
def test_bodies_of_any_size_arrive_whole(size: int, monkeypatch: pytest.MonkeyPatch) -> None:
    content = bytes(index % 251 for index in range(size))
    sent: list[int] = []
    original = http.client.HTTPConnection.send

    def note(connection: Any, data: Any) -> None:
        sent.append(len(data))
        original(connection, data)

    monkeypatch.setattr(http.client.HTTPConnection, "send", note)
    with server() as seen:
        straight = Connections(seen.url)
        for _ in range(2):
            received = straight.send("POST", "/v1/plan", {"X-Test": "yes"}, content, LIMITS)
            assert received.content == HEALTH
        straight.close()
        assert [asked[3] for asked in seen.asked] == [content, content]
    # A short one goes out with its head; a long one is not copied.
    assert len(sent) == (2 if size <= 65_000 else 4)


def test_without_httptools_the_standard_library_reads_responses() -> None:
    with server() as seen:
        code = (
            "import sys, http.client; sys.modules['httptools'] = None\n"
            "from armwright_client import Client, connections\n"
            "assert connections._Joined.response_class is http.client.HTTPResponse\n"
            f"with Client({seen.url!r}) as client: print(client.healthz().version)\n"
        )
        command = [sys.executable, "-c", code]
        ran = subprocess.run(command, check=False, capture_output=True, text=True)
    assert (ran.returncode, ran.stdout) == (0, "9.9\n"), ran.stderr
