"""States of jobs from the queue to success, and bounds of how many there are."""

import asyncio
import json
from pathlib import Path

import pytest

from service.jobs.runner import Jobs
from service.problem import ProblemError
from service.storage.store import Store
from service.storage.stores.job_store import JobAnswer, StoredRequest
from service.workers.faults import JobsFull, ShuttingDown
from tests.service.jobs.loop import App, ended, run, until
from tests.service.jobs.stored import REQUEST

BATCH = StoredRequest("POST", "/v1/plan/batch", "application/json", b"{}")


def test_a_job_is_queued_runs_and_succeeds(tmp_path: Path) -> None:
    async def scenario(jobs: Jobs, app: App, store: Store) -> None:
        accepted = await jobs.accept(REQUEST)
        assert accepted.status == "queued"
        assert store.jobs.request(accepted.id) == REQUEST
        await until(lambda: len(app.contexts) == 1)
        await until(lambda: store.jobs.get(accepted.id)[0].status == "running")
        app.contexts[0].on_progress(0.5, "search")
        running, answer = await jobs.get(accepted.id)
        assert (running.status, running.progress, running.stage) == ("running", 0.5, "search")
        assert answer is None
        assert len(jobs._live) == 1
        app.location = "/v1/robots/x"
        app.open.set()
        done, answer = await ended(jobs, accepted.id)
        await until(lambda: len(jobs._live) == 0)
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
    async def scenario(jobs: Jobs, app: App, store: Store) -> None:
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
