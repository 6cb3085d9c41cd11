"""Ends of jobs: cancelled, overdue, streamed to the end, resumed after a restart and forgotten."""

import asyncio
import json
from pathlib import Path
from typing import Any

from service.jobs.runner import Jobs
from service.storage.store import Store
from service.storage.stores.job_store import JobAnswer
from tests.service.jobs.loop import App, ended, run, until
from tests.service.jobs.stored import REQUEST, opened, record


def test_a_queued_job_is_cancelled_before_it_begins(tmp_path: Path) -> None:
    async def scenario(jobs: Jobs, app: App, store: Store) -> None:
        first, second = await jobs.accept(REQUEST), await jobs.accept(REQUEST)
        await until(lambda: len(app.contexts) == 1)
        assert (await jobs.cancel(second.id)).status == "cancelled"
        app.open.set()
        await ended(jobs, first.id)
        await asyncio.sleep(0.02)
        assert [context.id for context in app.contexts] == [first.id]

    run(tmp_path, scenario, workers=1)


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
