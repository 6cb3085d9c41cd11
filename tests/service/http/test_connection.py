"""Connections of a real server: heads that do not end, too many of them, and what is no HTTP."""

import json
import os
import re
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, NamedTuple

import httpx
import pytest

from service.http.layer.middleware import SECURITY_HEADERS
from tests.service.commands import serve
from tests.service.processes import children, descendants, wait_until
from tests.service.robots import FIELDS, bench, stuck
from tests.times import quickest

LIMIT = 20
ORIGIN = "https://cell.example"
SETTINGS = {
    "ARMWRIGHT_WORKERS": "1",
    "ARMWRIGHT_CONNECTION_LIMIT": str(LIMIT),
    "ARMWRIGHT_HEAD_TIMEOUT": "0.5",
    "ARMWRIGHT_BODY_TIMEOUT": "5",
    "ARMWRIGHT_BODY_DEADLINE": "1.0",
    "ARMWRIGHT_ALLOWED_HOSTS": "arm.example, .arms.example",
    "ARMWRIGHT_CORS_ORIGINS": ORIGIN,
}


class Running(NamedTuple):
    """A server in a process of its own."""

    process: "subprocess.Popen[str]"
    client: httpx.Client

    def connect(self) -> socket.socket:
        address = (self.client.base_url.host, self.client.base_url.port or 0)
        connection = socket.create_connection(address)
        connection.settimeout(5.0)
        return connection

    def exchange(self, sent: bytes) -> bytes:
        """Everything that is answered until the connection is closed."""
        with self.connect() as connection, suppress(ConnectionError):
            connection.sendall(sent)
            return read(connection)
        return b""


def read(connection: socket.socket) -> bytes:
    return b"".join(iter(lambda: connection.recv(65536), b""))


def read_one(connection: socket.socket) -> bytes:
    """One answer of a connection that stays open."""
    received = b""
    while not (length := re.search(rb"content-length: (\d+)\r\n.*?\r\n\r\n", received, re.DOTALL)):
        received += connection.recv(65536)
    while len(received) < length.end() + int(length[1]):
        received += connection.recv(65536)
    return received


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    data = tmp_path_factory.mktemp("connections")
    with serve(data, environment=SETTINGS) as (process, client):
        yield Running(process, client)


def refusal(raw: bytes, status: int, code: str) -> dict[str, Any]:
    head, _, body = raw.partition(b"\r\n\r\n")
    lines = head.decode().split("\r\n")
    assert lines[0].split()[1] == str(status), raw
    headers = {k.lower(): v for k, v in (line.split(": ", 1) for line in lines[1:])}
    assert headers["content-type"] == "application/problem+json"
    assert headers["connection"] == "close"
    for name, value in SECURITY_HEADERS.items():
        assert headers[name.lower()] == value
    document: dict[str, Any] = json.loads(body)
    assert set(document) == FIELDS
    assert (document["status"], document["code"]) == (status, code)
    return document


@pytest.mark.parametrize(
    "sent",
    [b"NONSENSE\r\n\r\n", b"\x16\x03\x01\x02\x00\x01\x00\r\n\r\n",
     b"GET / HTTP/1.1\r\nHost: x\r\nX: " + b"x" * 70_000],
)  # fmt: skip
def test_what_is_no_http_is_answered_by_a_problem(running: Running, sent: bytes) -> None:
    refusal(running.exchange(sent), 400, "INVALID_REQUEST")


def test_two_lengths_of_a_body_are_refused(running: Running) -> None:
    head = b"POST /v1/scenes HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
    both = b"Content-Length: 2\r\nTransfer-Encoding: chunked\r\n\r\n2\r\n{}\r\n0\r\n\r\n"
    document = refusal(running.exchange(head + both), 400, "INVALID_REQUEST")
    assert "Content-Length" in document["detail"]
    assert "Transfer-Encoding" in document["detail"]


@pytest.mark.parametrize("sent", [b"", b"GET / HT", b"GET / HTTP/1.1\r\nHost: x\r\n"])
def test_a_head_that_does_not_end_is_given_up(running: Running, sent: bytes) -> None:
    def attempt() -> float:
        began = time.monotonic()
        refusal(running.exchange(sent), 408, "REQUEST_TIMEOUT")
        return time.monotonic() - began

    assert 0.4 < quickest(attempt, 1.5) < 1.5


def test_a_second_head_that_does_not_end_is_given_up(running: Running) -> None:
    def attempt() -> float:
        with running.connect() as connection:
            connection.sendall(b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n")
            assert read_one(connection).startswith(b"HTTP/1.1 200")
            connection.sendall(b"GET /healthz HT")
            began = time.monotonic()
            refusal(read(connection), 408, "REQUEST_TIMEOUT")
            return time.monotonic() - began

    assert 0.4 < quickest(attempt, 1.5) < 1.5


def test_a_body_sent_byte_by_byte_is_given_up(running: Running) -> None:
    head = b"POST /v1/scenes HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"

    def attempt() -> float:
        with running.connect() as connection:
            connection.sendall(head + b"Content-Length: 1000\r\n\r\n")
            began = time.monotonic()
            connection.settimeout(0.05)
            answered = b""
            while not answered and time.monotonic() - began < 20.0:
                connection.sendall(b" ")
                try:
                    answered = connection.recv(65536)
                except TimeoutError:
                    continue
            assert answered.startswith(b"HTTP/1.1 408")
            return time.monotonic() - began

    assert 0.9 < quickest(attempt, 2.0) < 2.0


def test_connections_are_capped_and_others_are_told(running: Running) -> None:
    with ExitStack() as held:
        for _ in range(LIMIT + 5):
            held.enter_context(running.connect())
        with running.connect() as one_too_many:
            document = refusal(read(one_too_many), 503, "OVERLOADED")
    assert "too many connections" in document["detail"]
    assert running.client.get("/healthz").status_code == 200, "the others were let go"


def test_descriptors_are_left_for_workers(tmp_path: Path) -> None:
    """However many connections there are, a worker that dies is replaced, and health is told."""
    under, settings = ["prlimit", "--nofile=200:200"], {"ARMWRIGHT_WORKERS": "1"}
    with ExitStack() as held:
        process, client = held.enter_context(serve(tmp_path, environment=settings, under=under))
        running = Running(process, client)

        def alive() -> bool:
            return 'armwright_workers{state="alive"} 1.0' in client.get("/metrics").text

        assert wait_until(alive, 30.0)
        before = starts(client)
        # This client asks again and again, and so keeps its own connection.
        for number in range(250):
            held.enter_context(running.connect())
            if number % 50 == 0:
                assert client.get("/healthz").status_code == 200
        with running.connect() as one_too_many:
            refusal(read(one_too_many), 503, "OVERLOADED")
        for pid in descendants(process.pid):
            if not children(pid):
                os.kill(pid, signal.SIGKILL)
        assert wait_until(lambda: starts(client) > before, 30.0)
        assert wait_until(alive, 30.0)
        assert client.get("/readyz").status_code == 200


def starts(client: httpx.Client) -> float:
    """How many workers were started, the first ones too."""
    found = re.search(
        r"^armwright_worker_starts_total (\S+)", client.get("/metrics").text, re.MULTILINE
    )
    return float(found[1]) if found else 0.0


def test_large_bodies_that_are_held_take_no_memory(running: Running) -> None:
    def resident() -> float:
        with open(f"/proc/{running.process.pid}/statm") as file:  # noqa: PTH123
            return int(file.read().split()[1]) * 4096 / 2**20

    before, size, count = resident(), 8 * 2**20, 6
    head = b"POST /v1/scenes HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
    with ExitStack() as held:
        for _ in range(count):
            connection = held.enter_context(running.connect())
            connection.sendall(
                head + f"Content-Length: {size}\r\n\r\n".encode() + b" " * (size - 1)
            )
        assert resident() - before < 0.25 * count * size / 2**20


def test_a_server_with_too_much_work_refuses_before_it_parses(running: Running) -> None:
    """Plans that take their whole time, of more clients than can be served."""
    client = running.client
    assert client.post("/v1/robots", json=bench("busy")).status_code == 201
    body = json.dumps(stuck("busy", 0.6)).encode()
    head = f"POST /v1/plan HTTP/1.1\r\nHost: x\r\nContent-Length: {len(body)}\r\n"
    request = head.encode() + b"Content-Type: application/json\r\n\r\n" + body
    json_type = {"Content-Type": "application/json"}
    assert client.post("/v1/plan", content=body, headers=json_type).status_code in (422, 504)

    def attempt() -> float:
        with ExitStack() as held:
            connections = [held.enter_context(running.connect()) for _ in range(8)]
            for connection in connections:
                connection.sendall(request)
                time.sleep(0.01)
            began = time.monotonic()
            for connection in connections[2:]:
                answered = read_one(connection)
                assert answered.startswith(b"HTTP/1.1 429"), answered
                assert b"\r\nretry-after: " in answered.lower()
            took = time.monotonic() - began
            # The connection goes on as any other.
            connections[-1].sendall(b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n")
            assert read_one(connections[-1]).startswith(b"HTTP/1.1 200")
            first, second = (read_one(connection)[9:12] for connection in connections[:2])
            assert first in (b"422", b"504")
            assert second in (b"422", b"504", b"429"), "it may have come too late to wait"
            return took

    assert quickest(attempt, 0.5) < 0.5


def test_hosts_and_origins(running: Running) -> None:
    client = running.client
    for host in ("arm.example", "cell.arms.example:443", "localhost"):
        assert client.get("/healthz", headers={"Host": host}).status_code == 200
    refused = client.get("/healthz", headers={"Host": "evil.example"})
    assert (refused.status_code, refused.json()["code"]) == (421, "HOST_NOT_ALLOWED")
    asked = {"Access-Control-Request-Method": "POST", "Access-Control-Request-Headers": "If-Match"}
    allowed = client.options("/v1/plan", headers={"Origin": ORIGIN} | asked)
    assert allowed.status_code == 200
    assert allowed.headers["access-control-allow-origin"] == ORIGIN
    other = client.options("/v1/plan", headers={"Origin": "https://evil.example"} | asked)
    assert other.status_code == 400
    assert "access-control-allow-origin" not in other.headers
    read_by = client.get("/v1/robots/none", headers={"Origin": ORIGIN})
    assert read_by.headers["access-control-allow-origin"] == ORIGIN, "problems are read, too"


def test_a_body_on_its_way_when_the_service_ends_is_answered(running: Running) -> None:
    """The last test of this file: it ends the server."""
    process = running.process
    head = b"POST /v1/scenes HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
    with running.connect() as connection:
        connection.sendall(head + b"Content-Length: 1000000\r\n\r\n{")
        time.sleep(0.2)
        process.send_signal(signal.SIGTERM)
        answered = read(connection)
    assert process.wait(15.0) == 0
    assert answered[9:12] in (b"408", b"503")
    assert process.stderr is not None
    assert "Traceback" not in process.stderr.read()
