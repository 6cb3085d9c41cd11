"""Handles of jobs with a scripted service: waiting, ending, cancelling and their errors."""

import asyncio
import json
from itertools import pairwise
from typing import Any

import httpx
import pytest

import armwright_client as ours
from armwright_client import AsyncClient, Client
from armwright_client import call as call_module
from tests.client.scripted import Answer, Scripted, noted_pauses, problem

URL = "http://robots.example"
CERTIFICATE = {
    "verified": True, "proved": {"limits": True, "collisions": True, "reasons": []},
    "min_clearance": 0.1, "method": "m",
}  # fmt: skip
MOTION = ours.Trajectory(segments=[ours.Segment(t0=0, t1=1, coefficients=[[0, 1]])])


def job(status: str, http: int = 200, **more: Any) -> httpx.Response:
    return httpx.Response(http, json={"id": "7", "status": status} | more)


@pytest.fixture
def pauses(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The pauses that were made: the clock goes on by them, and nobody waits."""
    return noted_pauses(monkeypatch, call_module)


def pending(answers: list[Answer]) -> tuple[ours.Pending[ours.Certificate], Scripted]:
    """A validation that was accepted as job 7; the answers come when it is looked at."""
    transport = Scripted([job("queued", 202), *answers])
    client = Client(URL, transport=transport)
    return client.later.validate("r", MOTION), transport


def test_a_result_is_read_as_the_answer_of_its_request(pauses: list[float]) -> None:
    def done() -> httpx.Response:
        return job("succeeded", result=CERTIFICATE)

    async def awaited() -> ours.Certificate:
        transport = Scripted([job("queued", 202), job("running"), done()])
        async with AsyncClient(URL, transport=transport) as client:
            return await (await client.later.validate("r", MOTION)).wait()

    for answer in (pending([done()])[0].wait(), asyncio.run(awaited())):
        assert isinstance(answer, ours.Certificate)
        assert answer.verified
        assert answer.min_clearance == 0.1
    assert pauses == [0.02]


def test_pauses_grow_up_to_a_second(pauses: list[float]) -> None:
    answers: list[Answer] = [*(job("running") for _ in range(14))]
    handle, transport = pending([*answers, job("succeeded", result=CERTIFICATE)])
    handle.wait()
    assert pauses[0] == 0.02
    ratios = [b / a for a, b in pairwise(pauses[:10])]
    assert ratios == pytest.approx([1.5] * 9)
    assert pauses[-3:] == [1.0, 1.0, 1.0]
    paths = [request.url.path for request in transport.requests[1:]]
    assert paths == ["/v1/jobs/7"] * 15


def test_waiting_has_an_end(pauses: list[float]) -> None:
    handle, transport = pending([job("running") for _ in range(100)])
    with pytest.raises(ours.TransportTimeout, match="job 7 has not ended in time; it goes on"):
        handle.wait(0.5)
    assert sum(pauses) == pytest.approx(0.5)
    assert all(request.method != "DELETE" for request in transport.requests)


def test_without_any_time_a_job_is_looked_at_once(pauses: list[float]) -> None:
    handle, transport = pending([job("running")])
    with pytest.raises(ours.TransportTimeout):
        handle.wait(0.0)
    assert len(transport.requests) == 2
    done, _ = pending([job("succeeded", result=CERTIFICATE)])
    assert done.wait(0.0).verified


@pytest.mark.parametrize("code", sorted(ours.BY_CODE))
def test_a_failure_is_raised_as_the_error_of_its_code(pauses: list[float], code: str) -> None:
    error = {"code": code, "status": 418, "detail": "so it is", "hint": "Try this."}
    handle, _ = pending([job("failed", error=error)])
    with pytest.raises(ours.BY_CODE[code]) as raised:
        handle.wait()
    assert type(raised.value) is ours.BY_CODE[code]
    assert raised.value.status == 418
    assert str(raised.value) == f"{code}: so it is. Try this."


def test_a_failure_without_a_status_is_one_of_the_service(pauses: list[float]) -> None:
    handle, _ = pending([job("failed", error={"code": "FROM_THE_FUTURE"})])
    with pytest.raises(ours.ApiError) as raised:
        handle.wait()
    assert (type(raised.value), raised.value.status) == (ours.ApiError, 500)


@pytest.mark.parametrize("status", ["cancelled", "failed"])
def test_a_job_that_was_ended_is_preempted(pauses: list[float], status: str) -> None:
    results: list[dict[str, Any]] = [{}, {"result": CERTIFICATE}]
    for more in results:
        handle, _ = pending([job(status, **more)])
        with pytest.raises(ours.Preempted, match=f"job 7 was {status}") as raised:
            handle.wait()
        assert raised.value.status == 409


def test_a_handle_looks_at_its_job_and_ends_it() -> None:
    handle, transport = pending([job("running", progress=0.5), job("cancelled")])
    assert handle.id == "7"
    assert handle.job().progress == 0.5
    assert handle.cancel().status == "cancelled"
    requests = [(request.method, request.url.path) for request in transport.requests[1:]]
    assert requests == [("GET", "/v1/jobs/7"), ("DELETE", "/v1/jobs/7")]


def test_a_job_that_can_not_be_ended_says_so() -> None:
    handle, _ = pending([problem(409, "CONFLICT", detail="it has succeeded")])
    with pytest.raises(ours.Conflict, match="it has succeeded"):
        handle.cancel()


def test_a_job_is_waited_for_by_its_id_whatever_becomes_of_it(pauses: list[float]) -> None:
    for status in ("succeeded", "failed", "cancelled"):
        with Client(URL, transport=Scripted([job("running"), job(status)])) as client:
            assert client.jobs.wait("7").status == status

        async def awaited(last: str = status) -> ours.Job:
            transport = Scripted([job("running"), job(last)])
            async with AsyncClient(URL, transport=transport) as client:
                return await client.jobs.wait("7")

        assert asyncio.run(awaited()).status == status


@pytest.mark.parametrize(
    ("status", "done"),
    [("queued", False), ("running", False), ("succeeded", True), ("failed", True),
     ("cancelled", True), ("from_the_future", False)],
)  # fmt: skip
def test_a_job_has_ended_in_one_of_three_ways(status: str, done: bool) -> None:
    assert ours.Job(id="7", status=status).done is done


EVENTS = (
    b'id: 1\nevent: status\ndata: {"id":"7","status":"running","progress":0.25}\n\n'
    b": keep-alive\n\n"
    b'id: 2\nevent: end\ndata: {"id":"7","status":"failed","error":{"code":"CRASH"}}\n\n'
    b"id: 3\nevent: cut off\ndata: never completed"
)


def stream() -> httpx.Response:
    return httpx.Response(200, content=EVENTS, headers={"content-type": "text/event-stream"})


def test_events_come_as_they_are_told() -> None:
    handle, transport = pending([stream()])
    events = list(handle.events(after="5"))
    assert [(event.id, event.event) for event in events] == [("1", "status"), ("2", "end")]
    assert events[0].job().progress == 0.25
    error = events[1].job().error
    assert error is not None
    assert error.code == "CRASH"
    request = transport.requests[-1]
    assert (request.url.path, request.headers["last-event-id"]) == ("/v1/jobs/7/events", "5")

    async def awaited() -> list[ours.JobEvent]:
        async with AsyncClient(URL, transport=Scripted([stream()])) as client:
            return [event async for event in client.jobs.events("7")]

    assert asyncio.run(awaited()) == events


def test_events_of_a_job_that_is_not_there_are_an_error() -> None:
    with (
        Client(URL, transport=Scripted([problem(404, "NOT_FOUND")])) as client,
        pytest.raises(ours.NotFound),
    ):
        list(client.jobs.events("7"))


def test_events_without_a_listener_are_not_asked_for() -> None:
    transport = Scripted([])
    with Client(URL, transport=transport) as client:
        client.jobs.events("7")
    assert transport.requests == []


def test_a_request_for_later_has_no_deadline_of_its_own() -> None:
    transport = Scripted([job("queued", 202)])
    with Client(URL, transport=transport, timeout=3.0) as client:
        client.later.validate("r", MOTION, timeout=500.0)
    request = transport.requests[0]
    assert request.extensions["timeout"]["read"] == 3.0
    assert json.loads(request.content)["timeout"] == 500.0
