"""Requests on the wire, and connections and failures that the client reports."""

import asyncio
import contextlib
import gzip
import socket
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import httpx
import pytest

import armwright_client as ours
from armwright_client import AsyncClient, Client, Retry, session
from armwright_client.client import items, items_async
from tests.client.scripted import (
    URL,
    Answer,
    Scripted,
    asked_async,
    health,
    noted_pauses,
    once,
    problem,
)

SCENE = ours.Scene(name="s", obstacles=[])
SUMMARY = {"name": "s", "hash": "0", "version": 1, "created": "now", "updated": "now"}


def asked(transport: Scripted, ask: Callable[[Client], Any], **options: Any) -> httpx.Request:
    with Client(URL, transport=transport, **options) as client:
        ask(client)
    return transport.requests[-1]


def silence(request: httpx.Request) -> float:
    return float(request.extensions["timeout"]["read"])


def test_both_clients_send_the_same() -> None:
    def ask(client: Any) -> Any:
        return client.scenes.create(SCENE, idempotency_key="k-1")

    summary = SUMMARY
    waited = asked(Scripted([httpx.Response(201, json=summary)]), ask)
    awaited = asyncio.run(asked_async(Scripted([httpx.Response(201, json=summary)]), ask))
    assert waited.content == awaited.content == b'{"name":"s","obstacles":[]}'
    assert (waited.method, waited.url) == (awaited.method, awaited.url)
    assert waited.headers == awaited.headers
    assert waited.headers["idempotency-key"] == "k-1"
    assert waited.headers["content-type"] == "application/json"
    assert waited.headers["user-agent"] == f"armwright-client/{ours.__version__}"
    assert "authorization" not in waited.headers
    assert waited.headers["accept-encoding"] == "identity"
    packed = asked(Scripted([httpx.Response(201, json=summary)]), ask, compress=True)
    assert packed.headers["accept-encoding"] == "gzip"


def test_a_prefix_of_the_base_url_is_kept() -> None:
    for url in ("https://host/arms", "https://host/arms/"):
        transport = Scripted([health()])
        with Client(url, transport=transport) as client:
            assert client.healthz().version == "9.9"
        assert str(transport.requests[0].url) == "https://host/arms/healthz"


def test_names_are_quoted() -> None:
    transport = Scripted([httpx.Response(204)])
    request = asked(transport, lambda client: client.robots.delete("a/b?c#d é"))
    assert request.url.raw_path == b"/v1/robots/a%2Fb%3Fc%23d%20%C3%A9"


@pytest.mark.parametrize("name", ["", ".", ".."])
def test_names_that_would_be_another_path_are_refused(name: str) -> None:
    transport = Scripted([])
    with pytest.raises(ours.InvalidArgument, match="can't be a name"):
        asked(transport, lambda client: client.robots.delete(name))
    assert transport.requests == []


def test_the_token_is_sent_and_not_shown() -> None:
    secret = "s3cret-t0ken"
    transport = Scripted([health(), httpx.ConnectError("refused")])
    with Client(URL, token=secret, transport=transport) as client:
        client.healthz()
        assert transport.requests[0].headers["authorization"] == f"Bearer {secret}"
        with pytest.raises(ours.TransportError) as caught:
            client.healthz()
        assert secret not in f"{caught.value!r} {client!r} {vars(client)!r}"
    for token in ("", f"{secret}\n", f"{secret} {secret}", f"{secret}é"):
        with pytest.raises(ours.InvalidArgument) as refused:
            Client(URL, token=token)
        assert secret not in str(refused.value)


@pytest.mark.parametrize("url", ["robots.example", "ftp://host", "http://", "http://h/?a=b", ""])
def test_what_is_no_base_url_is_refused(url: str) -> None:
    with pytest.raises(ours.InvalidArgument, match="base URL"):
        Client(url)


def test_an_archive_goes_as_a_form() -> None:
    archive = ours.RobotArchive("arm", b"PK-content", {"tip_link": "tool"})
    answer = problem(422, "INVALID_ROBOT_DESCRIPTION")
    transport = Scripted([answer])
    with pytest.raises(ours.InvalidRobotDescription):
        asked(transport, lambda client: client.robots.create(archive))
    request = transport.requests[0]
    assert request.headers["content-type"].startswith("multipart/form-data; boundary=")
    for part in (b'name="file"; filename="arm.zip"', b"PK-content", b'name="tip_link"', b"tool"):
        assert part in request.content


def test_a_plan_is_waited_for_as_long_as_it_may_take() -> None:
    def ask(timeout: float | None) -> Callable[[Client], Any]:
        options: ours.PlanOptions = {} if timeout is None else {"timeout": timeout}
        return lambda client: client.plan("r", [0.0], [1.0], **options)

    def waited(deadline: float | None, **options: Any) -> float:
        transport = Scripted([problem(422, "PLANNING_FAILED")])
        with pytest.raises(ours.PlanningFailed):
            asked(transport, ask(deadline), **options)
        return silence(transport.requests[0])

    assert waited(None) == 60.0
    assert waited(5.0) == 60.0
    assert waited(300.0) > 300.0
    assert waited(5.0, timeout=1.0) > 5.0
    assert waited(None, timeout=1.0) == 1.0


@pytest.mark.parametrize(
    "ask",
    [
        lambda client: client.check("r", [0.0], timeout=300.0),
        lambda client: client.check_batch("r", [[0.0]], timeout=300.0),
        lambda client: client.robots.ik("r", ours.Pose.at(0, 0, 0), timeout=300.0),
        lambda client: client.retime([[0.0], [1.0]], timeout=300.0),
        lambda client: client.validate(
            "r",
            ours.Trajectory(segments=[ours.Segment(t0=0, t1=1, coefficients=[[0]])]),
            timeout=300.0,
        ),
        lambda client: client.simulate(
            "r",
            ours.Trajectory(segments=[ours.Segment(t0=0, t1=1, coefficients=[[0]])]),
            {"type": "computed_torque"},
            timeout=300.0,
        ),
    ],
)
def test_every_deadline_is_heeded(ask: Callable[[Client], Any]) -> None:
    transport = Scripted([problem(422, "INVALID_REQUEST")])
    with pytest.raises(ours.InvalidRequest):
        asked(transport, ask)
    assert silence(transport.requests[0]) > 300.0


@pytest.fixture
def pauses(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The pauses that were made, without making them."""
    return noted_pauses(monkeypatch, session)


def busy(after: str | None = "2", status: int = 429) -> httpx.Response:
    return problem(status, "OVERLOADED", {} if after is None else {"Retry-After": after})


@pytest.mark.parametrize("status", [429, 503])
def test_what_is_not_possible_now_is_asked_for_again(pauses: list[float], status: int) -> None:
    answers: list[Answer] = [busy("2", status), busy("0", status), health()]
    assert once(answers, lambda client: client.healthz()).status == "ok"
    assert pauses == [2.0, 0.0]
    pauses.clear()
    answers = [busy("2", status), busy("0", status), health()]
    asyncio.run(asked_async(Scripted(answers), lambda client: client.healthz()))
    assert pauses == [2.0, 0.0]


def test_retries_end(pauses: list[float]) -> None:
    with pytest.raises(ours.Overloaded) as caught:
        once([busy("1"), busy("2"), busy("3"), health()], lambda client: client.healthz())
    assert pauses == [1.0, 2.0]
    assert (caught.value.status, caught.value.retry_after) == (429, 3.0)


@pytest.mark.parametrize(
    "after", [None, "", "11", "1.5", "soon", "-1", "nan", "1e3", "9" * 400, "²"]
)
def test_no_retry_without_a_time_that_can_be_waited(pauses: list[float], after: str | None) -> None:
    headers = [] if after is None else [(b"retry-after", after.encode())]
    refusal = problem(429, "OVERLOADED")
    refusal.headers = httpx.Headers([*refusal.headers.raw, *headers])
    with pytest.raises(ours.Overloaded):
        once([refusal], lambda client: client.healthz())
    assert pauses == []


def test_a_date_is_waited_for(pauses: list[float]) -> None:
    later = format_datetime(datetime.now(UTC) + timedelta(seconds=8), usegmt=True)
    past = format_datetime(datetime.now(UTC) - timedelta(seconds=8), usegmt=True)
    once([busy(later), busy(past), health()], lambda client: client.healthz())
    assert 6.0 < pauses[0] <= 8.0
    assert pauses[1] == 0.0


@pytest.mark.parametrize("status", [500, 501, 502, 504])
def test_other_failures_are_not_asked_for_again(pauses: list[float], status: int) -> None:
    with pytest.raises(ours.ApiError):
        once([problem(status, "CRASH", {"Retry-After": "1"})], lambda client: client.healthz())
    assert pauses == []


def test_what_creates_is_repeated_only_with_a_key(pauses: list[float]) -> None:
    stored = httpx.Response(201, json=SUMMARY)
    with pytest.raises(ours.Overloaded):
        once([busy()], lambda client: client.scenes.create(SCENE))
    assert pauses == []
    once([busy(), stored], lambda client: client.scenes.create(SCENE, idempotency_key="k"))
    assert pauses == [2.0]


def test_readiness_is_told_at_once(pauses: list[float]) -> None:
    warming = problem(503, "NOT_READY", {"Retry-After": "1"})
    with pytest.raises(ours.NotReady) as caught:
        once([warming], lambda client: client.readyz())
    assert isinstance(caught.value, ours.Unavailable)
    assert caught.value.retry_after == 1.0
    assert pauses == []


def test_retries_can_be_chosen(pauses: list[float]) -> None:
    with pytest.raises(ours.Overloaded):
        once([busy()], lambda client: client.healthz(), retry=Retry(attempts=1))
    once([busy("60"), health()], lambda client: client.healthz(), retry=Retry(2, 60.0))
    assert pauses == [60.0]


@dataclass
class Numbers:
    """A page of numbers."""

    numbers: list[int]
    next: str | None


PAGES = {None: Numbers([1, 2], "b"), "b": Numbers([], "c"), "c": Numbers([3], None)}


def test_all_items_come_once_and_pages_when_needed() -> None:
    asked: list[str | None] = []

    def read(after: str | None) -> Numbers:
        asked.append(after)
        return PAGES[after]

    numbers = items(read, lambda page: page.numbers)
    assert (next(numbers), next(numbers), asked) == (1, 2, [None])
    assert list(numbers) == [3]
    assert asked == [None, "b", "c"]


def test_awaited_pages_are_the_same() -> None:
    async def read(after: str | None) -> Numbers:
        return PAGES[after]

    async def collect() -> list[int]:
        return [one async for one in items_async(read, lambda page: page.numbers)]

    assert asyncio.run(collect()) == [1, 2, 3]


def test_the_client_asks_for_page_after_page() -> None:
    def answer(request: httpx.Request) -> httpx.Response:
        after = request.url.params.get("after")
        names = ["a", "b"] if after is None else ["c"]
        robots = [{"name": name, "built_in": True, "joints": 6} for name in names]
        return httpx.Response(200, json={"robots": robots, "next": None if after else "b"})

    with Client(transport=httpx.MockTransport(answer)) as client:
        assert [robot.name for robot in client.robots.iterate()] == ["a", "b", "c"]


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
