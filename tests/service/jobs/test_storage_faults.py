"""Jobs while the storage can't be used: nothing is lost, and all goes on by itself."""

import asyncio
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from service.jobs.runner import Jobs
from service.storage.database import StorageUnavailable
from service.storage.store import Store
from tests.service.jobs.loop import App, ended, run, until
from tests.service.jobs.stored import REQUEST


@pytest.fixture(autouse=True)
def _short_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.storage.database._LOCK_TIMEOUT", 0.05)
    monkeypatch.setattr("service.jobs.execution.STORAGE_RETRY", 0.02)
    monkeypatch.setattr("service.jobs.runner._CANCEL_TIMEOUT", 0.3)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """The database, locked by somebody else."""
    other = sqlite3.connect(folder / "armwright.db", isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    try:
        yield
    finally:
        other.execute("ROLLBACK")
        other.close()


def test_the_end_of_a_job_is_told_once_it_is_stored(tmp_path: Path) -> None:
    async def scenario(jobs: Jobs, app: App, store: Store) -> None:
        first = await jobs.accept(REQUEST)
        await until(lambda: len(app.contexts) == 1)
        await until(lambda: store.jobs.get(first.id)[0].status == "running")
        second = await jobs.accept(REQUEST)
        with locked(tmp_path):
            app.open.set()
            await until(lambda: store.database.fault is not None)
            await asyncio.sleep(0.3)
            assert (await jobs.get(first.id))[0].status == "running"
            with pytest.raises(StorageUnavailable):
                await jobs.accept(REQUEST)
        for job in (first, second):
            record, answer = await ended(jobs, job.id)
            assert record.status == "succeeded"
            assert store.jobs.get(job.id) == (record, answer)
        await until(lambda: len(jobs._live) == 0)
        # Its slot is free again.
        third = await jobs.accept(REQUEST)
        assert (await ended(jobs, third.id))[0].status == "succeeded"

    run(tmp_path, scenario, workers=1)


def test_a_job_is_cancelled_once_that_can_be_stored(tmp_path: Path) -> None:
    async def scenario(jobs: Jobs, app: App, store: Store) -> None:
        job = await jobs.accept(REQUEST)
        await until(lambda: store.jobs.get(job.id)[0].status == "running")
        with locked(tmp_path):
            with pytest.raises(StorageUnavailable):
                await jobs.cancel(job.id)
            assert app.cancelled == 1, "its work ends at once"
        record, _ = await ended(jobs, job.id)
        assert record.status == "cancelled"
        assert store.jobs.get(job.id)[0] == record
        assert (await jobs.cancel(job.id)) == record

    run(tmp_path, scenario)


def test_a_request_that_meets_a_storage_fault_is_answered_again(tmp_path: Path) -> None:
    async def scenario(jobs: Jobs, app: App, store: Store) -> None:
        app.status, app.body = 503, b'{"code": "STORAGE_UNAVAILABLE"}'
        app.open.set()
        job = await jobs.accept(REQUEST)
        await until(lambda: len(app.contexts) >= 3)
        assert (await jobs.get(job.id))[0].status == "running"
        app.status, app.body = 200, b"{}"
        assert (await ended(jobs, job.id))[0].status == "succeeded"

    run(tmp_path, scenario)
