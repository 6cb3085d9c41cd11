"""All jobs of a service in one event loop: an application of a few lines stands in for ours."""

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from service.http.job_context import JOB_CONTEXT, JobContext
from service.jobs.runner import Jobs
from service.problem import ProblemError
from service.settings import Settings
from service.storage.document_store import SqliteStore
from service.storage.job_store import JobAnswer, JobRecord, StoredRequest
from service.workers.faults import JobsFull, ShuttingDown
from tests.service.jobs.stored import REQUEST, opened, record

BATCH = StoredRequest("POST", "/v1/plan/batch", "application/json", b"{}")


class App:
    """Answers when it is told to, and notes what reaches it."""

    def __init__(self) -> None:
        self.contexts: list[JobContext] = []
        self.bodies: list[bytes] = []
        self.open = asyncio.Event()
        self.status, self.location = 200, ""
        self.error: Exception | None = None
        self.cancelled = 0

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        context: JobContext = scope[JOB_CONTEXT]
        self.contexts.append(context)
        self.bodies.append((await receive())["body"])
        context.on_start()
        try:
            await self.open.wait()
        except asyncio.CancelledError:
            self.cancelled += 1
            raise
        if self.error is not None:
            raise self.error
        headers = [(b"content-type", b"application/json")]
        headers += [(b"location", self.location.encode())] if self.location else []
        await send({"type": "http.response.start", "status": self.status, "headers": headers})
        await send({"type": "http.response.body", "body": b'{"done": true}'})


Scenario = Callable[[Jobs, App, SqliteStore], Awaitable[None]]


def run(folder: Path, scenario: Scenario, **settings: Any) -> None:
    """Carry out a scenario with all jobs of a service, which ends afterwards."""

    async def whole() -> None:
        app = App()
        with opened(folder) as store:
            options: dict[str, Any] = {"workers": 2, "keep_alive": 0.05, "data_dir": folder}
            jobs = Jobs(app, store.jobs, Settings(**(options | settings)))
            await jobs.start()
            try:
                await asyncio.wait_for(scenario(jobs, app, store), 20.0)
            finally:
                await jobs.stop()

    asyncio.run(whole())


async def until(condition: Callable[[], bool]) -> None:
    """Wait until something is so."""
    while not condition():
        await asyncio.sleep(0.002)


async def ended(jobs: Jobs, job: str) -> tuple[JobRecord, JobAnswer | None]:
    while True:
        found = await jobs.get(job)
        if found[0].ended is not None:
            return found
        await asyncio.sleep(0.002)


def test_a_job_is_queued_runs_and_succeeds(tmp_path: Path) -> None:
    async def scenario(jobs: Jobs, app: App, store: SqliteStore) -> None:
        accepted = await jobs.accept(REQUEST)
        assert accepted.status == "queued"
        assert store.jobs.request(accepted.id) == REQUEST
        await until(lambda: len(app.contexts) == 1)
        await until(lambda: store.jobs.get(accepted.id)[0].status == "running")
        app.contexts[0].on_progress(0.5, "search")
        running, answer = await jobs.get(accepted.id)
        assert (running.status, running.progress, running.stage) == ("running", 0.5, "search")
        assert answer is None
        assert jobs.unfinished_count == 1
        app.location = "/v1/robots/x"
        app.open.set()
        done, answer = await ended(jobs, accepted.id)
        await until(lambda: jobs.unfinished_count == 0)
        assert (done.status, done.progress, done.location) == ("succeeded", 1.0, "/v1/robots/x")
        assert answer == JobAnswer("application/json", b'{"done": true}')
        assert store.jobs.get(accepted.id) == (done, answer)
        assert app.bodies == [REQUEST.body]

    run(tmp_path, scenario)


@pytest.mark.parametrize(
    ("status", "outcome"), [(200, "succeeded"), (201, "succeeded"), (399, "succeeded"),
                            (400, "failed"), (422, "failed"), (503, "failed")]
)  # fmt: skip
def test_the_status_of_the_answer_decides(tmp_path: Path, status: int, outcome: str) -> None:
    async def scenario(jobs: Jobs, app: App, store: SqliteStore) -> None:
        app.status = status
        app.open.set()
        job = await jobs.accept(REQUEST)
        done, answer = await ended(jobs, job.id)
        assert done.status == outcome
        assert answer is not None
        assert answer.content == b'{"done": true}'

    run(tmp_path, scenario)


@pytest.mark.parametrize(
    ("error", "code"),
    [(RuntimeError("secret"), "CRASH"), (ProblemError("OVERLOADED", "later"), "OVERLOADED")],
)
def test_whatever_happens_a_job_ends(tmp_path: Path, error: Exception, code: str) -> None:
    async def scenario(jobs: Jobs, app: App, store: SqliteStore) -> None:
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
    async def scenario(jobs: Jobs, app: App, store: SqliteStore) -> None:
        accepted = [await jobs.accept(REQUEST) for _ in range(5)]
        await until(lambda: len(app.contexts) == 2)
        await asyncio.sleep(0.03)
        assert [context.id for context in app.contexts] == [job.id for job in accepted[:2]]
        await jobs.cancel(accepted[2].id)
        app.open.set()
        await until(lambda: jobs.unfinished_count == 0)
        assert [context.id for context in app.contexts] == [
            job.id for job in accepted if job is not accepted[2]
        ]

    run(tmp_path, scenario)


def test_batches_have_a_queue_of_their_own(tmp_path: Path) -> None:
    async def scenario(jobs: Jobs, app: App, store: SqliteStore) -> None:
        batches = [await jobs.accept(BATCH) for _ in range(4)]
        plan = await jobs.accept(REQUEST)
        await until(lambda: len(app.contexts) == 3)
        await asyncio.sleep(0.03)
        assert [c.id for c in app.contexts] == [batches[0].id, batches[1].id, plan.id]
        app.open.set()
        await until(lambda: jobs.unfinished_count == 0)

    run(tmp_path, scenario, workers=1)


# --------------------------------------------------------------------------------- refusals


def test_too_many_jobs_are_refused_until_one_has_ended(tmp_path: Path) -> None:
    async def scenario(jobs: Jobs, app: App, store: SqliteStore) -> None:
        first = await jobs.accept(REQUEST)
        await jobs.accept(REQUEST)
        with pytest.raises(JobsFull):
            await jobs.accept(REQUEST)
        assert len(store.jobs.list(None, "", 10)) == 2
        await jobs.cancel(first.id)
        await jobs.accept(REQUEST)

    run(tmp_path, scenario, job_limit=2)


def test_waiting_requests_have_so_much_room_together(tmp_path: Path) -> None:
    mebibyte = 1024 * 1024

    async def scenario(jobs: Jobs, app: App, store: SqliteStore) -> None:
        jobs.check_room(100 * mebibyte)  # alone, even a larger one is taken
        half = StoredRequest("POST", "/v1/plan", "application/json", b" " * (mebibyte // 2))
        first = await jobs.accept(half)
        await jobs.accept(half)
        with pytest.raises(JobsFull):
            jobs.check_room(1)
        await jobs.cancel(first.id)
        jobs.check_room(mebibyte // 2)
        with pytest.raises(JobsFull):
            jobs.check_room(mebibyte // 2 + 1)

    run(tmp_path, scenario, job_storage=mebibyte)


def test_a_service_that_ends_takes_no_more(tmp_path: Path) -> None:
    async def scenario(jobs: Jobs, app: App, store: SqliteStore) -> None:
        await jobs.stop()
        for refused in (jobs.accept(REQUEST), jobs.keep(REQUEST, JobAnswer("", b""), None)):
            with pytest.raises(ShuttingDown):
                await refused
        assert store.jobs.list(None, "", 10) == []

    run(tmp_path, scenario)


# ------------------------------------------------------------------------------ cancelling


def test_a_running_job_is_cancelled_with_its_work(tmp_path: Path) -> None:
    async def scenario(jobs: Jobs, app: App, store: SqliteStore) -> None:
        job = await jobs.accept(REQUEST)
        await until(lambda: len(app.contexts) == 1)
        cancelled = await jobs.cancel(job.id)
        assert cancelled.status == "cancelled"
        await until(lambda: app.cancelled == 1)
        found, answer = await jobs.get(job.id)
        assert (found.status, answer) == ("cancelled", None)
        assert (await jobs.cancel(job.id)).ended == cancelled.ended, "it stays as it was"

    run(tmp_path, scenario)


def test_a_queued_job_is_cancelled_before_it_begins(tmp_path: Path) -> None:
    async def scenario(jobs: Jobs, app: App, store: SqliteStore) -> None:
        first, second = await jobs.accept(REQUEST), await jobs.accept(REQUEST)
        await until(lambda: len(app.contexts) == 1)
        assert (await jobs.cancel(second.id)).status == "cancelled"
        app.open.set()
        await ended(jobs, first.id)
        await asyncio.sleep(0.02)
        assert [context.id for context in app.contexts] == [first.id]

    run(tmp_path, scenario, workers=1)


@pytest.mark.parametrize("status", [200, 422])
def test_what_has_ended_can_not_be_cancelled(tmp_path: Path, status: int) -> None:
    async def scenario(jobs: Jobs, app: App, store: SqliteStore) -> None:
        app.status = status
        app.open.set()
        job = await jobs.accept(REQUEST)
        done, _ = await ended(jobs, job.id)
        await until(lambda: jobs.unfinished_count == 0)
        with pytest.raises(ProblemError) as conflict:
            await jobs.cancel(job.id)
        assert conflict.value.code == "CONFLICT"
        assert conflict.value.details["status_of_job"] == done.status
        assert (await jobs.get(job.id))[0] == done

    run(tmp_path, scenario)


@pytest.mark.parametrize("name", ["", "nobody", "0" * 31, "0" * 33, "G" * 32, "0" * 32])
def test_a_job_that_is_not_there_is_not_found(tmp_path: Path, name: str) -> None:
    async def scenario(jobs: Jobs, app: App, store: SqliteStore) -> None:
        for refused in (jobs.get(name), jobs.cancel(name), jobs.events(name, 0)):
            with pytest.raises(ProblemError) as missing:
                await refused
            assert missing.value.code == "NOT_FOUND"

    run(tmp_path, scenario)


# -------------------------------------------------------------------------------- deadlines


def test_a_job_that_does_not_end_in_time_is_ended(tmp_path: Path) -> None:
    async def scenario(jobs: Jobs, app: App, store: SqliteStore) -> None:
        job = await jobs.accept(REQUEST)
        done, answer = await ended(jobs, job.id)
        assert done.status == "failed"
        assert answer is not None
        problem = json.loads(answer.content)
        assert (problem["code"], problem["stage"]) == ("TIMED_OUT", "job")
        assert "within 0.05 s" in problem["detail"]
        assert app.cancelled == 1

    run(tmp_path, scenario, job_deadline=0.05)


# ----------------------------------------------------------------------------------- events


def test_events_go_on_until_the_end_with_signs_of_life(tmp_path: Path) -> None:
    async def scenario(jobs: Jobs, app: App, store: SqliteStore) -> None:
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
        await until(lambda: jobs.unfinished_count == 0)
        done, _ = await jobs.get(job.id)
        assert await jobs.events(job.id, done.event) is None, "all events were received"
        last = await jobs.events(job.id, done.event - 1)
        assert last is not None
        assert [block async for block in last] == [received[-1]]

    run(tmp_path, scenario)


def test_streams_end_when_the_service_does(tmp_path: Path) -> None:
    async def scenario(jobs: Jobs, app: App, store: SqliteStore) -> None:
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


# --------------------------------------------------------------------- restarts and lifetime


def test_what_waited_goes_on_and_what_ran_has_failed(tmp_path: Path) -> None:
    with opened(tmp_path) as store:
        store.jobs.add(record(1), REQUEST)
        store.jobs.add(record(2, status="running", started=5.0), REQUEST)

    async def scenario(jobs: Jobs, app: App, store: SqliteStore) -> None:
        app.open.set()
        done, _ = await ended(jobs, record(1).id)
        assert done.status == "succeeded"
        lost, answer = await jobs.get(record(2).id)
        assert lost.status == "failed"
        assert answer is not None
        assert json.loads(answer.content)["code"] == "CRASH"
        assert [context.id for context in app.contexts] == [record(1).id]

    run(tmp_path, scenario)


def test_old_answers_are_forgotten_at_the_start_and_when_a_job_ends(tmp_path: Path) -> None:
    with opened(tmp_path) as store:
        store.jobs.add(record(1, status="succeeded", ended=1.0), None)

    async def scenario(jobs: Jobs, app: App, store: SqliteStore) -> None:
        await until(lambda: store.jobs.list(None, "", 10) == [])
        app.open.set()
        accepted = [await jobs.accept(REQUEST) for _ in range(4)]
        await until(lambda: jobs.unfinished_count == 0)
        await until(lambda: len(store.jobs.list(None, "", 10)) == 2)
        kept = {job.id for job in store.jobs.list(None, "", 10)}
        assert kept <= {job.id for job in accepted}

    run(tmp_path, scenario, job_count=2)


def test_a_request_that_is_answered_at_once_becomes_a_job_that_has_succeeded(
    tmp_path: Path,
) -> None:
    async def scenario(jobs: Jobs, app: App, store: SqliteStore) -> None:
        answer = JobAnswer("application/json", b"{}")
        done = await jobs.keep(REQUEST, answer, "/v1/scenes/a")
        assert (done.status, done.location) == ("succeeded", "/v1/scenes/a")
        assert await jobs.get(done.id) == (done, answer)
        assert jobs.unfinished_count == 0
        assert app.contexts == []

    run(tmp_path, scenario)


def test_later_jobs_sort_after_earlier_ones(tmp_path: Path) -> None:
    async def scenario(jobs: Jobs, app: App, store: SqliteStore) -> None:
        ids = []
        for _ in range(5):
            ids.append((await jobs.accept(REQUEST)).id)
            await asyncio.sleep(0.003)
        assert ids == sorted(ids)
        assert [job.id for job in await jobs.list(None, "", 10)] == ids[::-1]
        await until(lambda: len(app.contexts) == 2)
        live = await jobs.list("queued", "", 10)
        assert {job.id for job in live} >= set(ids[2:])

    run(tmp_path, scenario)
