"""Refusals before anything is parsed: which requests are simple, and who is refused with what."""

import json
from typing import Any

import pytest

from service.http.admission import Admission, SimpleRequest, named_timeout, read_simple
from service.settings import Settings
from service.workers.coming import ComingRequests
from service.workers.faults import QueueFull

SETTINGS = Settings(default_timeout=10.0, max_timeout=60.0)


def post(path: str, body: bytes, *more: str) -> bytes:
    lines = [f"POST {path} HTTP/1.1", "Host: x", f"Content-Length: {len(body)}", *more]
    return "\r\n".join(lines).encode() + b"\r\n\r\n" + body


class Supervisor:
    """Workers that have so much to do."""

    has_work = True
    is_free = False

    def __init__(self, wait: float) -> None:
        self.wait = wait
        self.coming = ComingRequests()
        self.asked: list[tuple[str, float, str]] = []

    def early_refusal(self, task: str, seconds: float, client: str, _size: int) -> QueueFull | None:
        self.asked.append((task, seconds, client))
        return QueueFull(3, 7, self.wait) if self.wait > seconds else None


def admission(wait: float) -> tuple[Admission, Supervisor]:
    supervisor: Any = Supervisor(wait)
    made = Admission(supervisor, SETTINGS)
    made.note("POST", "/v1/robots/panda/ik", "service.tasks:ik")
    made.note("GET", "/v1/robots/plan", "service.tasks:urdf")
    return made, supervisor


def test_a_post_in_one_piece_is_simple() -> None:
    request = read_simple(post("/v1/plan", b"{}", "Content-Type: application/json"))
    assert request is not None
    assert request == ("/v1/plan", b"{}", 0)


def test_what_is_missing_of_a_body_is_counted() -> None:
    whole = post("/v1/plan", b'{"timeout": 2}')
    assert read_simple(whole[:-3]) == ("/v1/plan", b'{"timeout":', 3)


@pytest.mark.parametrize(
    "data",
    [b"", b"GET /v1/plan HTTP/1.1\r\nHost: x\r\n\r\n", post("/v1/plan", b"{}")[:30],
     post("/v1/plan", b"{}") + b"x", post("/v1/plan", b"{}", "Content-Length: 2"),
     post("/v1/plan", b"{}", "Transfer-Encoding: chunked"), post("/v1/plan", b"{}", "Expect: x"),
     post("/v1/plan", b"{}", "Prefer: respond-async"), post("/v1/plan", b"{}", "Upgrade: x"),
     post("/v1/plan", b"{}", "connection: Close"), post("/v1/plan?x=1", b"{}"),
     post("/v1/plan", b"{}").replace(b"1.1", b"1.0"), post("/docs", b"{}")],
)  # fmt: skip
def test_all_others_take_the_usual_way(data: bytes) -> None:
    assert read_simple(data) is None


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


def test_what_would_be_too_late_is_refused_with_a_problem() -> None:
    gate, supervisor = admission(5.0)
    answer = gate.refusal(SimpleRequest("/v1/robots/ur5e/ik", b'{"timeout": 2}'), "10.0.0.1", 1)
    assert answer is not None
    assert supervisor.asked == [("service.tasks:ik", 2.0, "10.0.0.1")]
    head, _, body = answer.partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 429 ")
    assert b"Retry-After: 7" in head
    assert f"Content-Length: {len(body)}".encode() in head
    document = json.loads(body)
    assert (document["code"], document["instance"]) == ("OVERLOADED", "/v1/robots/ur5e/ik")
    assert "5.0 s until this one begins" in document["detail"]


def test_others_are_let_in_and_count_until_they_are_answered() -> None:
    gate, supervisor = admission(5.0)
    assert gate.refusal(SimpleRequest("/v1/robots/ur5e/ik", b'{"timeout": 9}'), "c", 1) is None
    assert len(supervisor.coming) == 1
    assert gate.refusal(SimpleRequest("/v1/plan", b'{"timeout": 1}'), "c", 2) is None, (
        "not known yet"
    )
    assert (len(supervisor.asked), len(supervisor.coming)) == (1, 1)
    gate.forget(2)
    gate.forget(1)
    assert not supervisor.coming


def test_the_rest_of_a_short_body_is_waited_for_while_there_is_work() -> None:
    gate, supervisor = admission(5.0)

    def is_awaited(data: bytes) -> bool:
        request = read_simple(data)
        return request is not None and gate.wants_rest(request)

    whole = post("/v1/robots/ur5e/ik", b'{"timeout": 2}')
    assert is_awaited(whole[:-3])
    assert is_awaited(whole.partition(b"{")[0])
    assert not is_awaited(whole), "nothing is missing"
    assert not is_awaited(whole[:30]), "the head is not complete"
    assert not is_awaited(post("/v1/plan", b"{}")[:-1]), "not known yet"
    large = post("/v1/robots/ur5e/ik", b" " * 70_000)
    assert not is_awaited(large[:-1])
    supervisor.has_work = False
    assert not is_awaited(whole[:-3])


def test_nothing_is_asked_where_a_worker_is_free() -> None:
    workers = Supervisor(wait=100.0)
    admission = Admission(workers, Settings())  # type: ignore[arg-type]
    admission.note("POST", "/v1/plan", "plan")
    request = SimpleRequest("/v1/plan", b'{"timeout": 1}')
    workers.is_free = True
    assert admission.refusal(request, "c", 1) is None
    assert not workers.asked
    assert len(workers.coming) == 1
    workers.is_free = False
    assert admission.refusal(request, "c", 2) is not None
