"""Jobs of two servers that share a PostgreSQL database: each done once, and seen by both."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from service.jobs.runner import Jobs
from service.settings import Settings
from service.storage.store import open_store
from service.validation import ProblemError
from tests.service.jobs.loop import App, ended, until
from tests.service.jobs.stored import REQUEST
from tests.service.postgresql import PostgreSQL

Scenario = Callable[[Jobs, App, Jobs, App], Awaitable[None]]


@pytest.fixture(autouse=True)
def _short_periods(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.storage.stores.server_store.LIFETIME", 0.6)
    monkeypatch.setattr("service.jobs.execution.HEARTBEAT", 0.1)
    monkeypatch.setattr("service.jobs.execution._SHARING_PERIOD", 0.05)
    monkeypatch.setattr("service.jobs.execution._POLL_PERIOD", 0.05)


def run(url: str, folder: Path, scenario: Scenario) -> None:
    """Carry out a scenario with the jobs of two servers."""

    async def whole() -> None:
        stores = [open_store(url), open_store(url)]
        apps = [App(), App()]
        settings = Settings(data_dir=folder, workers=1, keep_alive=0.05)
        one, other = (Jobs(a, s, settings) for a, s in zip(apps, stores, strict=True))
        await one.start()
        await other.start()
        try:
            await asyncio.wait_for(scenario(one, apps[0], other, apps[1]), 20.0)
        finally:
            await one.stop()
            await other.stop()
            for store in stores:
                store.close()

    asyncio.run(whole())


def freeze(jobs: Jobs) -> None:
    """Let a server fall silent: its heart stops, its work goes on."""
    for chore in list(jobs._chores):
        chore.cancel()


def test_the_other_server_sees_a_job_and_its_answer(postgresql: PostgreSQL, tmp_path: Path) -> None:
    async def scenario(one: Jobs, app: App, other: Jobs, idle: App) -> None:
        job = await one.accept(REQUEST)
        await until(lambda: len(app.contexts) == 1)
        stream = await other.events(job.id, 0)
        assert stream is not None
        app.contexts[0].on_progress(0.5, "rrt_connect")
        asyncio.get_running_loop().call_later(0.4, app.open.set)
        kinds = [block.split(b"\n")[1] async for block in stream if block.startswith(b"id")]
        assert kinds[-1] == b"event: end"
        assert set(kinds[:-1]) == {b"event: status"}
        record, answer = await other.get(job.id)
        assert (record.status, record.stage) == ("succeeded", "rrt_connect")
        assert answer == (await ended(one, job.id))[1]
        assert idle.contexts == []

    run(postgresql.database(), tmp_path, scenario)


def test_a_job_is_cancelled_through_the_other_server(
    postgresql: PostgreSQL, tmp_path: Path
) -> None:
    async def scenario(one: Jobs, app: App, other: Jobs, _: App) -> None:
        job = await one.accept(REQUEST)
        await until(lambda: len(app.contexts) == 1)
        assert (await other.cancel(job.id)).status == "cancelled"
        await until(lambda: app.cancelled == 1)
        assert (await ended(one, job.id))[0].status == "cancelled"
        assert (await other.cancel(job.id)).status == "cancelled"

    run(postgresql.database(), tmp_path, scenario)


def test_jobs_of_a_server_that_ends_go_on_at_the_other(
    postgresql: PostgreSQL, tmp_path: Path
) -> None:
    async def scenario(one: Jobs, app: App, other: Jobs, taker: App) -> None:
        jobs = [await one.accept(REQUEST) for _ in range(3)]
        await until(lambda: len(app.contexts) == 1)
        taker.open.set()
        await one.stop()
        for job in jobs:
            assert (await ended(other, job.id))[0].status == "succeeded"
        assert sorted(c.id for c in taker.contexts) == [job.id for job in jobs]

    run(postgresql.database(), tmp_path, scenario)


def test_what_a_frozen_server_did_late_is_refused(postgresql: PostgreSQL, tmp_path: Path) -> None:
    async def scenario(one: Jobs, app: App, other: Jobs, taker: App) -> None:
        running, waiting = await one.accept(REQUEST), await one.accept(REQUEST)
        await until(lambda: len(app.contexts) == 1)
        await asyncio.sleep(0.1)
        freeze(one)
        taker.open.set()
        for job in (running, waiting):
            assert (await ended(other, job.id))[0].status == "succeeded"
        assert [context.id for context in taker.contexts] == [running.id, waiting.id]
        done = await other.get(running.id)
        assert done[0].attempt == 2
        app.body = b'{"late": true}'
        app.open.set()  # the frozen server goes on, and answers
        assert await ended(one, running.id) == done
        assert (await other.get(running.id)) == done
        with pytest.raises(ProblemError, match="has ended already"):
            await one.cancel(running.id)

    run(postgresql.database(), tmp_path, scenario)
