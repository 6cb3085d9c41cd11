"""What goes over the wire, and what becomes of what comes back or does not."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from typing import Any

import httpx
import pytest

import armwright_client as ours
from armwright_client import Client, Retry, session
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
