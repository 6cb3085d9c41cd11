"""Jobs from the queue to their end: states, progress, bounds, restarts."""

import asyncio
import json
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from prometheus_client.parser import text_string_to_metric_families

from service.jobs.execution import Event, LiveJob, describe, waiting_again
from service.jobs.runner import Jobs
from service.storage.store import Store
from service.storage.stores.job_store import ENDED, JobAnswer, Status, StoredRequest
from service.validation import ProblemError
from service.workers.state import JobsFull, ShuttingDown
from tests.service.conftest import Served
from tests.service.jobs.loop import App, ended, run, until
from tests.service.jobs.requests import ASYNC, EASY, STUCK, batch, began, submit
from tests.service.jobs.requests import ended as ended_job
from tests.service.jobs.stored import REQUEST, opened, record
from tests.service.processes import kill_in_work
from tests.service.robots import (
    answer,
    problem,
)

BATCH = StoredRequest("POST", "/v1/plan/batch", "application/json", b"{}")


@pytest.mark.parametrize(
    ("status", "outcome"), [(200, "succeeded"), (201, "succeeded"), (399, "succeeded"),
                            (400, "failed"), (422, "failed"), (503, "failed")]
)  # fmt: skip
def test_the_status_of_the_answer_decides(tmp_path: Path, status: int, outcome: str) -> None:
    async def scenario(jobs: Jobs, app: App, store: Store) -> None:
        app.status = status
        app.open.set()
        job = await jobs.accept(REQUEST)
        done, answer = await ended(jobs, job.id)
        assert done.status == outcome
        assert answer is not None
        assert answer.content == b'{"done": true}'
        assert len(app.contexts) == 1

    run(tmp_path, scenario)


@pytest.mark.parametrize(
    ("error", "code"),
    [(RuntimeError("secret"), "CRASH"), (ProblemError("OVERLOADED", "later"), "OVERLOADED")],
)
def test_whatever_happens_a_job_ends(tmp_path: Path, error: Exception, code: str) -> None:
    async def scenario(jobs: Jobs, app: App, store: Store) -> None:
        app.error = error
        app.open.set()
        job = await jobs.accept(REQUEST)
        done, answer = await ended(jobs, job.id)
        assert done.status == "failed"
        assert answer is not None
        problem = json.loads(answer.content)
        assert (problem["code"], problem["instance"]) == (code, "/v1/plan")
        assert "secret" not in answer.content.decode()
        second = await jobs.accept(REQUEST)
        await ended(jobs, second.id)

    run(tmp_path, scenario)


def test_as_many_jobs_run_as_there_are_workers_in_the_order_they_came(tmp_path: Path) -> None:
    async def scenario(jobs: Jobs, app: App, store: Store) -> None:
        accepted = [await jobs.accept(REQUEST) for _ in range(5)]
        await until(lambda: len(app.contexts) == 2)
        await asyncio.sleep(0.03)
        # The first two begin at the same time.
        assert {context.id for context in app.contexts} == {job.id for job in accepted[:2]}
        await jobs.cancel(accepted[2].id)
        app.open.set()
        await until(lambda: len(jobs._live) == 0)
        # The last two begin at the same time.
        assert {context.id for context in app.contexts[2:]} == {accepted[3].id, accepted[4].id}

    run(tmp_path, scenario)


def test_batches_have_a_queue_of_their_own(tmp_path: Path) -> None:
    async def scenario(jobs: Jobs, app: App, store: Store) -> None:
        batches = [await jobs.accept(BATCH) for _ in range(4)]
        plan = await jobs.accept(REQUEST)
        await until(lambda: len(app.contexts) == 3)
        await asyncio.sleep(0.03)
        # Jobs that begin at the same time come in any order.
        assert {c.id for c in app.contexts} == {batches[0].id, batches[1].id, plan.id}
        app.open.set()
        await until(lambda: len(jobs._live) == 0)

    run(tmp_path, scenario, workers=1)


def test_waiting_requests_have_so_much_room_together(tmp_path: Path) -> None:
    mebibyte = 1024 * 1024

    async def scenario(jobs: Jobs, app: App, store: Store) -> None:
        await jobs.check_room(100 * mebibyte)  # alone, even a larger one is taken
        half = StoredRequest("POST", "/v1/plan", "application/json", b" " * (mebibyte // 2))
        first = await jobs.accept(half)
        await jobs.accept(half)
        with pytest.raises(JobsFull):
            await jobs.check_room(1)
        await jobs.cancel(first.id)
        await jobs.check_room(mebibyte // 2)
        with pytest.raises(JobsFull):
            await jobs.check_room(mebibyte // 2 + 1)

    run(tmp_path, scenario, job_storage=mebibyte)


def test_a_service_that_ends_takes_no_more(tmp_path: Path) -> None:
    async def scenario(jobs: Jobs, app: App, store: Store) -> None:
        await jobs.stop()
        for refused in (jobs.accept(REQUEST), jobs.keep(REQUEST, JobAnswer("", b""), None)):
            with pytest.raises(ShuttingDown):
                await refused
        assert store.jobs.list(None, "", 10) == []

    run(tmp_path, scenario)


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
    again = waiting_again(job.record)
    assert (again.status, again.progress, again.stage, again.started) == ("queued", 0.0, None, None)
    assert (again.id, again.created, again.event) == (job.record.id, job.record.created, 3)


def test_an_event_on_the_wire_is_as_the_standard_has_it() -> None:
    assert Event(7, "stage", b'{"a":1}').encode() == b'id: 7\nevent: stage\ndata: {"a":1}\n\n'
    text = describe(record(stage="line\nbreak"), "status").encode()
    assert text.count(b"\n") == 4, "data stays on its line"


def test_events_go_on_until_the_end_with_signs_of_life(tmp_path: Path) -> None:
    async def scenario(jobs: Jobs, app: App, store: Store) -> None:
        job = await jobs.accept(REQUEST)
        stream = await jobs.events(job.id, 0)
        assert stream is not None
        received: list[bytes] = []
        async for block in stream:
            received.append(block)
            if block.startswith(b": keep-alive"):
                app.open.set()
        kinds = [block.split(b"\n")[1] for block in received if block.startswith(b"id")]
        assert kinds == [b"event: status", b"event: status", b"event: end"]
        assert b": keep-alive\n\n" in received
        await until(lambda: len(jobs._live) == 0)
        done, _ = await jobs.get(job.id)
        assert await jobs.events(job.id, done.event) is None, "all events were received"
        last = await jobs.events(job.id, done.event - 1)
        assert last is not None
        assert [block async for block in last] == [received[-1]]

    run(tmp_path, scenario)


def test_streams_end_when_the_service_does(tmp_path: Path) -> None:
    async def scenario(jobs: Jobs, app: App, store: Store) -> None:
        job = await jobs.accept(REQUEST)
        stream = await jobs.events(job.id, 0)
        assert stream is not None
        asyncio.get_running_loop().call_later(0.03, lambda: stopping.append(stop()))
        stopping: list[Any] = []

        def stop() -> Any:
            return asyncio.ensure_future(jobs.stop())

        received = [block async for block in stream]
        assert not any(b"event: end" in block for block in received)
        await stopping[0]
        assert store.jobs.get(job.id)[0].status == "queued", "it goes on at the next start"
        assert await jobs.events(job.id, 0) is None

    run(tmp_path, scenario, keep_alive=60.0)


def test_what_waited_or_ran_goes_on_when_its_server_has_died(tmp_path: Path) -> None:
    with opened(tmp_path) as store:
        store.jobs.add(record(1), REQUEST)
        store.jobs.add(record(2, status="running", started=5.0, progress=0.7), REQUEST)
        store.jobs.add(record(3, status="running", started=5.0, attempt=2), REQUEST)

    async def scenario(jobs: Jobs, app: App, store: Store) -> None:
        again, _ = await jobs.get(record(2).id)
        assert (again.attempt, again.progress) == (2, 0.0)
        assert store.jobs.get(record(2).id)[0].attempt == 2
        app.open.set()
        for number in (1, 2):
            assert (await ended(jobs, record(number).id))[0].status == "succeeded"
        lost, answer = await jobs.get(record(3).id)
        assert lost.status == "failed"
        assert answer is not None
        problem = json.loads(answer.content)
        assert (problem["code"], "2 times" in problem["detail"]) == ("CRASH", True)
        assert {context.id for context in app.contexts} == {record(1).id, record(2).id}

    run(tmp_path, scenario)


def test_old_answers_are_forgotten_at_the_start_and_when_a_job_ends(tmp_path: Path) -> None:
    with opened(tmp_path) as store:
        store.jobs.add(record(1, status="succeeded", ended=1.0), JobAnswer("", b""))

    async def scenario(jobs: Jobs, app: App, store: Store) -> None:
        await until(lambda: store.jobs.list(None, "", 10) == [])
        app.open.set()
        accepted = [await jobs.accept(REQUEST) for _ in range(4)]
        await until(lambda: len(jobs._live) == 0)
        await until(lambda: len(store.jobs.list(None, "", 10)) == 2)
        kept = {job.id for job in store.jobs.list(None, "", 10)}
        assert kept <= {job.id for job in accepted}

    run(tmp_path, scenario, job_count=2)


def test_a_request_that_is_answered_at_once_becomes_a_job_that_has_succeeded(
    tmp_path: Path,
) -> None:
    async def scenario(jobs: Jobs, app: App, store: Store) -> None:
        answer = JobAnswer("application/json", b"{}")
        done = await jobs.keep(REQUEST, answer, "/v1/scenes/a")
        assert (done.status, done.location) == ("succeeded", "/v1/scenes/a")
        assert await jobs.get(done.id) == (done, answer)
        assert len(jobs._live) == 0
        assert app.contexts == []

    run(tmp_path, scenario)


@contextmanager
def limits(served: Served, **changes: Any) -> Iterator[None]:
    """The service with other limits for a while."""
    held = served.app.state.jobs
    before = held._settings
    held._settings = before.model_copy(update=changes)
    try:
        yield
    finally:
        held._settings = before


def test_too_many_jobs_are_refused(jobs: Served) -> None:
    client = jobs.client
    with limits(jobs, job_limit=2):
        held = [submit(client, STUCK) for _ in range(2)]
        response = client.post("/v1/plan", json=EASY, headers=ASYNC)
        problem(response, 429, "OVERLOADED")
        assert int(response.headers["retry-after"]) >= 1
        problem(client.post("/v1/plan/batch", json={"problems": [EASY]}), 429, "OVERLOADED")
        answer(client.post("/v1/plan", json=EASY))  # who waits is not concerned
        for job in held:
            answer(client.delete(job))
        assert ended_job(client, submit(client, EASY))["status"] == "succeeded"


def test_a_job_must_end_in_time(jobs: Served) -> None:
    client = jobs.client
    with limits(jobs, job_deadline=1.0):
        body = {"problems": [EASY, STUCK, STUCK, EASY]}
        results = batch(client, body)["result"]["results"]
        assert [result.get("code") for result in results] == [None, *["TIMED_OUT"] * 3]
        alone = ended_job(client, submit(client, STUCK))
        error = alone["error"]
        assert (alone["status"], error["code"], error["stage"]) == ("failed", "TIMED_OUT", "job")
        assert "within 1 s" in error["detail"]


def test_metrics_count_by_what_is_ours(jobs: Served) -> None:
    client = jobs.client
    stuck = submit(client, STUCK)
    began(client, stuck, "rrt_connect")
    kill_in_work(jobs.supervisor, signal.SIGKILL, signal.SIGKILL)  # it is begun twice
    assert ended_job(client, stuck)["error"]["code"] == "CRASH"
    for _ in range(6):
        answer(client.post("/v1/plan", json=EASY))
    assert ended_job(client, submit(client, EASY))["status"] == "succeeded"
    client.get("/v1/nothing/like/this")
    client.get("/v1/robots/nobody-of-this-name")
    client.request("BREW", "/v1/robots")
    answer(client.post("/v1/plan", json=EASY))
    response = client.get("/metrics")
    assert response.headers["content-type"].startswith("text/plain; version=0.0.4")
    families = {family.name: family for family in text_string_to_metric_families(response.text)}
    requests = families["armwright_requests"].samples
    counted = {
        tuple(sample.labels[name] for name in ("route", "method", "status"))
        for sample in requests
        if sample.name.endswith("_total")
    }
    assert ("/v1/robots/{name}", "GET", "404") in counted
    assert ("unmatched", "GET", "404") in counted
    assert ("/v1/plan", "POST", "200") in counted
    assert ("/v1/plan", "POST", "202") in counted
    assert "nobody-of-this-name" not in response.text
    assert "BREW" not in response.text
    assert len(counted) < 60

    def value(name: str, sample_name: str = "", **labels: str) -> float:
        return sum(
            sample.value
            for sample in families[name].samples
            if sample.name == (sample_name or name) and labels.items() <= sample.labels.items()
        )

    assert value("armwright_plans", "armwright_plans_total", code="SUCCESS") > 5
    assert value("armwright_plans", "armwright_plans_total", planner="straight_line") > 5
    assert value("armwright_plans", "armwright_plans_total", code="CRASH") >= 1
    assert value("armwright_stage_seconds", "armwright_stage_seconds_count", stage="timing") > 5
    assert value("armwright_workers", state="wanted") == 2
    assert value("armwright_queue_length") == 0
    assert value("armwright_jobs", status="succeeded") >= 1
    assert value("armwright_worker_starts", "armwright_worker_starts_total") > 2
    assert value("armwright_work", "armwright_work_total", outcome="crashed") >= 1
