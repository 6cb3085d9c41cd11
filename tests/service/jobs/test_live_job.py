"""A job that waits or runs: its states, its progress and its events."""

import asyncio
import json
import time
from typing import Any

import pytest

from service.jobs.live_job import Event, LiveJob, describe
from service.storage.stores.job_store import ENDED, JobAnswer, Status
from tests.service.jobs.stored import record

PROBLEM = JobAnswer("application/problem+json", b'{"code": "CRASH"}')


def live(**changes: Any) -> LiveJob:
    return LiveJob(record(**changes), 10.0, 100)


def told(job: LiveJob, after: int = 0) -> list[tuple[str, str, float, str | None]]:
    """Kind, status, progress and stage of the events after one of a number."""
    events = [(event.kind, json.loads(event.data)) for event in job.since(after)]
    return [(kind, data["status"], data["progress"], data["stage"]) for kind, data in events]


def test_a_job_is_taken_up_once() -> None:
    job = live()
    before = time.time()
    assert job.start()
    first = job.record.started
    assert first is not None
    assert before <= first <= time.time()
    assert job.record.status == "running"
    assert not job.start(), "a worker that begins anew is no news"
    assert job.record.started == first
    assert [kind for kind, *_ in told(job)] == ["status", "status"]


@pytest.mark.parametrize("status", ENDED)
def test_a_job_that_has_ended_is_not_taken_up(status: Status) -> None:
    job = live()
    job.end(status, None)
    assert job.has_ended
    assert not job.start()
    job.advance(0.9, "late")
    assert job.record.stage is None
    assert told(job)[-1][:2] == ("end", status)


def test_progress_never_goes_back_nor_beyond_the_whole() -> None:
    job = live()
    for progress, expected in ((0.5, 0.5), (0.2, 0.5), (0.7, 0.7), (7.0, 1.0), (-1.0, 1.0)):
        job.advance(progress, "search")
        assert job.record.progress == expected


def test_what_changes_nothing_is_not_told() -> None:
    job = live()
    job.advance(0.5, "search")
    job.advance(0.5, "search")
    job.advance(0.4, "search")
    job.advance(0.6, "search")
    job.advance(0.6, "proof")
    assert told(job, after=1) == [
        ("stage", "queued", 0.5, "search"),
        ("progress", "queued", 0.6, "search"),
        ("stage", "queued", 0.6, "proof"),
    ]


def test_only_success_is_the_whole_of_it() -> None:
    for status, progress in (("succeeded", 1.0), ("failed", 0.3), ("cancelled", 0.3)):
        job = live()
        job.advance(0.3, "search")
        job.end(status, PROBLEM if status == "failed" else None, "/v1/robots/x")  # type: ignore[arg-type]
        assert job.record.progress == progress
        assert job.record.location == "/v1/robots/x"
        assert job.record.ended is not None


def test_events_are_counted_on_across_restarts() -> None:
    job = live(event=41)
    job.start()
    assert [event.number for event in job.since(0)] == [42, 43]
    assert [event.number for event in job.since(42)] == [43]
    assert list(job.since(43)) == []
    assert list(job.since(10**9)) == []


def test_a_late_listener_gets_the_last_events() -> None:
    job = live()
    for step in range(1000):
        job.advance((step + 1) / 1000, "search")
    numbers = [event.number for event in job.since(0)]
    assert numbers == list(range(746, 1002))


def test_a_job_that_waits_again_has_done_nothing_yet() -> None:
    job = live()
    job.start()
    job.advance(0.5, "search")
    again = job.wait_again()
    assert (again.status, again.progress, again.stage, again.started) == ("queued", 0.0, None, None)
    assert (again.id, again.created, again.event) == (job.record.id, job.record.created, 3)


def test_whoever_waits_for_a_change_is_woken_by_each() -> None:
    async def listen() -> int:
        job, woken = live(), 0
        for step in range(3):
            changed = job.changed
            waiting = asyncio.ensure_future(changed.wait())
            await asyncio.sleep(0)
            assert not waiting.done()
            job.advance(0.1 * (step + 1), "search")
            await asyncio.wait_for(waiting, 1.0)
            woken += 1
        return woken

    assert asyncio.run(listen()) == 3


def test_an_event_on_the_wire_is_as_the_standard_has_it() -> None:
    assert Event(7, "stage", b'{"a":1}').encode() == b'id: 7\nevent: stage\ndata: {"a":1}\n\n'
    text = describe(record(stage="line\nbreak"), "status").encode()
    assert text.count(b"\n") == 4, "data stays on its line"
