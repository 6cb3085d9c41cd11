"""Refusals before anything is parsed: which requests are judged, and who is refused with what."""

import asyncio
import time
from typing import Any

import pytest

from service.http.errors import headers_of
from service.http.layer import admission as admission_module
from service.http.layer.admission import Admission, named_timeout
from service.http.request_headers import FIELDS, first_values
from service.settings import Settings
from service.workers.load import InFlight
from service.workers.state import QueueFull

SETTINGS = Settings(default_timeout=10.0, max_timeout=60.0)
IK = "/v1/robots/ur5e/ik"


class Supervisor:
    """Workers that have so much to do."""

    is_free = False

    def __init__(self, wait: float) -> None:
        self.wait = wait
        self.in_flight = InFlight()
        self.asked: list[tuple[str, float, str, int]] = []

    def early_refusal(self, task: str, seconds: float, client: str, size: int) -> QueueFull | None:
        self.asked.append((task, seconds, client, size))
        return QueueFull(3, 7, self.wait) if self.wait > seconds else None


@pytest.fixture(autouse=True)
def _no_pause(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(admission_module, "_PAUSE", 0.0)


def admission(wait: float) -> tuple[Admission, Supervisor]:
    supervisor: Any = Supervisor(wait)
    made = Admission(supervisor, SETTINGS)
    made.record_task("POST", "/v1/robots/panda/ik", "service.endpoints:ik")
    made.record_task("GET", "/v1/robots/plan", "service.endpoints:urdf")
    return made, supervisor


def scope_of(path: str, method: str = "POST", **headers: str) -> dict[str, Any]:
    fields = [(n.replace("_", "-").encode(), value.encode()) for n, value in headers.items()]
    client = ("10.0.0.1", 7)
    scope = {"type": "http", "method": method, "path": path, "headers": fields, "client": client}
    return scope | {FIELDS: first_values(scope)}


async def pass_gate(gate: Admission, scope: dict[str, Any], content: bytes) -> None:
    async with gate.admitted(scope, content):
        pass


@pytest.mark.parametrize(
    ("content", "seconds"),
    [(b"{}", 10.0), (b'{"timeout": 2}', 2.0), (b'{"timeout" :2.5e0}', 2.5),
     (b'{"timeout": 1e9}', 60.0), (b'{"timeout": null}', 10.0),
     (b'{"a": {"timeout": 1}, "timeout": 3}', 3.0),
     (b'{"a": {"timeout": 5}, "timeout": 3, "b": "\\"timeout\\""}', 5.0),
     (b'{"a": ["timeout"], "timeouts": 7}', 10.0)],
)  # fmt: skip
def test_the_timeout_is_read_without_parsing(content: bytes, seconds: float) -> None:
    assert named_timeout(content, SETTINGS) == seconds


def test_what_would_be_too_late_is_refused() -> None:
    gate, supervisor = admission(5.0)
    with pytest.raises(QueueFull, match=r"5\.0 s until this one begins") as refused:
        asyncio.run(pass_gate(gate, scope_of(IK), b'{"timeout": 2}'))
    assert supervisor.asked == [("service.endpoints:ik", 2.0, "10.0.0.1", 14)]
    assert (refused.value.code, refused.value.retry_after) == ("OVERLOADED", 7)
    asyncio.run(pass_gate(gate, scope_of(IK), b'{"timeout": 9}'))


def test_refusals_have_a_pause(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever asks again at once is slowed down."""
    monkeypatch.setattr(admission_module, "_PAUSE", 0.05)
    gate, _ = admission(5.0)
    began = time.monotonic()
    with pytest.raises(QueueFull):
        asyncio.run(pass_gate(gate, scope_of(IK), b'{"timeout": 2}'))
    assert time.monotonic() - began >= 0.04


@pytest.mark.parametrize(
    "scope",
    [scope_of("/v1/plan"), scope_of("/healthz", "GET"), scope_of(IK, "GET"),
     scope_of(IK, prefer="respond-async")],
)  # fmt: skip
def test_all_others_are_let_in(scope: dict[str, Any]) -> None:
    gate, supervisor = admission(5.0)
    asyncio.run(pass_gate(gate, scope, b'{"timeout": 2}'))
    large = [*scope["headers"], (b"content-length", b"99999999")]
    asyncio.run(gate.check_announced(scope | {FIELDS: first_values({"headers": large})}))
    assert supervisor.asked == []


def test_a_large_body_is_not_read_where_no_timeout_would_be_long_enough() -> None:
    gate, supervisor = admission(5.0)
    large = scope_of(IK, content_length="1000000")
    asyncio.run(gate.check_announced(large))
    assert supervisor.asked == [("service.endpoints:ik", 60.0, "10.0.0.1", 1_000_000)]
    supervisor.wait = 100.0
    with pytest.raises(Exception, match="too late for its deadline") as refused:
        asyncio.run(gate.check_announced(large))
    headers = headers_of(refused.value)  # type: ignore[arg-type]
    assert headers == {"Connection": "close", "Retry-After": "7"}
    asyncio.run(gate.check_announced(scope_of(IK, content_length="1000")))
    asyncio.run(gate.check_announced(scope_of(IK, content_length="9" * 50)))
    asyncio.run(gate.check_announced(scope_of(IK)))
    assert len(supervisor.asked) == 2, "a short body is read first, a larger one than any refused"


def test_those_let_in_count_until_they_are_answered() -> None:
    gate, supervisor = admission(5.0)

    async def run() -> None:
        async with gate.admitted(scope_of(IK), b""), gate.admitted(scope_of("/v1/plan"), b""):
            assert supervisor.in_flight.count == 1
            assert supervisor.in_flight.ahead("10.0.0.1", 0) == 1

    asyncio.run(run())
    assert supervisor.in_flight.count == 0


def test_a_crowd_is_let_in_one_in_each_turn_of_the_event_loop() -> None:
    """Health and refusals come between, and each counts from its arrival on."""
    gate, supervisor = admission(5.0)
    seen: list[str] = []

    async def ask() -> None:
        async with gate.admitted(scope_of(IK), b""):
            assert supervisor.in_flight.count >= 3 - seen.count("asked")
            seen.append("asked")

    async def run() -> None:
        crowd = [asyncio.create_task(ask()) for _ in range(3)]
        await asyncio.sleep(0)
        assert supervisor.in_flight.count == 3
        while seen.count("asked") < 3:
            seen.append("health")
            await asyncio.sleep(0)
        await asyncio.gather(*crowd)

    asyncio.run(run())
    assert "asked asked" not in " ".join(seen)


def test_nothing_is_asked_where_a_worker_is_free() -> None:
    gate, workers = admission(100.0)
    workers.is_free = True
    asyncio.run(pass_gate(gate, scope_of(IK), b'{"timeout": 1}'))
    assert not workers.asked
