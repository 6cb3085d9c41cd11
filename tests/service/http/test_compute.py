"""Time limits of requests, and clients that leave."""

import asyncio
import time
from types import SimpleNamespace
from typing import Any

import pytest
from fastapi import Request

from service.http.compute import allowed_time, compute
from service.http.layer.request_checks import ARRIVAL
from service.http.state import DRY_RUN, JOB_CONTEXT, DeferToJob, JobContext
from service.settings import Settings
from service.validation import ProblemError
from service.workers.process import Background
from service.workers.task import Job
from tests.service import chores

RESULT = 3
SETTINGS = Settings(default_timeout=7.0, max_timeout=20.0)


class Supervisor:
    """Notes what is submitted, and answers after a while."""

    def __init__(self, seconds: float = 0.0) -> None:
        self.seconds = seconds
        self.jobs: list[tuple[Job[Any], Any, Background | None]] = []
        self.cancelled = False

    async def submit(
        self,
        job: Job[Any],
        on_progress: Any = None,
        background: Background | None = None,
        client: str = "",
    ) -> Any:
        self.client = client
        self.jobs.append((job, on_progress, background))
        try:
            await asyncio.sleep(self.seconds)
        except asyncio.CancelledError:
            self.cancelled = True
            raise
        return RESULT


def request(
    supervisor: Supervisor, scope: dict[str, Any] | None = None, leaves_after: float = 3600.0
) -> Request:
    async def receive() -> dict[str, Any]:
        await asyncio.sleep(leaves_after)
        return {"type": "http.disconnect"}

    admission = SimpleNamespace(record_task=lambda *_: None)
    state = SimpleNamespace(settings=SETTINGS, supervisor=supervisor, admission=admission)
    app = SimpleNamespace(state=state)
    plain = {"type": "http", "headers": [], "app": app, "method": "POST", "path": "/v1/plan"}
    return Request(plain | (scope or {}), receive)


@pytest.mark.parametrize(("timeout", "seconds"), [(None, 7.0), (0.5, 0.5), (20.0, 20.0)])
def test_the_default_is_resolved_once(timeout: float | None, seconds: float) -> None:
    supervisor = Supervisor()
    before = time.monotonic()
    assert asyncio.run(compute(request(supervisor), chores.add.job(1, 2), timeout)) == RESULT
    ((job, _, background),) = supervisor.jobs
    assert before + seconds <= job.deadline.at <= time.monotonic() + seconds
    assert background is None


def test_the_time_begins_with_the_first_byte() -> None:
    supervisor = Supervisor()
    scope = {ARRIVAL: 1000.0, "client": ("10.0.0.7", 1234)}
    asyncio.run(compute(request(supervisor, scope), chores.add.job(1, 2), 2.5))
    ((job, _, _),) = supervisor.jobs
    assert job.deadline.at == 1002.5
    assert supervisor.client == "10.0.0.7"


def test_a_longer_time_than_the_service_allows_is_refused() -> None:
    supervisor = Supervisor()
    with pytest.raises(ProblemError, match=r"21 s is longer than the 20 s") as refused:
        asyncio.run(compute(request(supervisor), chores.add.job(1, 2), 21.0))
    assert refused.value.details == {"max_timeout": 20.0}
    assert supervisor.jobs == []
    assert allowed_time(SETTINGS, None) == 7.0


def test_a_dry_run_ends_before_the_work() -> None:
    supervisor = Supervisor()
    with pytest.raises(DeferToJob):
        asyncio.run(compute(request(supervisor, {DRY_RUN: True}), chores.add.job(1, 2)))
    assert supervisor.jobs == []


def test_the_time_of_a_job_begins_with_its_worker() -> None:
    supervisor = Supervisor()
    seen: list[Any] = []
    context = JobContext("id", 1.0, lambda: seen.append("start"), lambda *told: seen.append(told))
    asked = request(supervisor, {JOB_CONTEXT: context})
    assert asyncio.run(compute(asked, chores.add.job(1, 2), 3.0)) == RESULT
    ((job, on_progress, background),) = supervisor.jobs
    assert job.deadline.at == float("inf")
    assert background == Background(3.0, context.on_start)
    on_progress(0.5, "x")
    assert seen == [(0.5, "x")]


def test_a_client_that_leaves_ends_the_work() -> None:
    supervisor = Supervisor(seconds=30.0)
    begun = time.monotonic()
    with pytest.raises(ProblemError) as left:
        asyncio.run(compute(request(supervisor, leaves_after=0.05), chores.burn.job()))
    assert (left.value.code, left.value.status) == ("PREEMPTED", 499)
    assert supervisor.cancelled
    assert time.monotonic() - begun < 5.0


def test_whoever_cancels_a_request_is_not_taken_for_its_client() -> None:
    supervisor = Supervisor(3600.0)

    async def run() -> None:
        working = asyncio.create_task(compute(request(supervisor), chores.add.job(1, 2)))
        await asyncio.sleep(0.01)
        working.cancel()
        with pytest.raises(asyncio.CancelledError):
            await working
        await asyncio.sleep(0)
        assert len(asyncio.all_tasks()) == 1, "nobody waits for the client any more"

    asyncio.run(run())
    assert supervisor.cancelled


def test_a_time_limit_around_a_request_is_told_as_one() -> None:
    supervisor = Supervisor(3600.0)

    async def run() -> None:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.01):
                await compute(request(supervisor), chores.add.job(1, 2))

    asyncio.run(run())
    assert supervisor.cancelled


def test_a_connection_that_fails_counts_as_one_that_has_ended() -> None:
    supervisor = Supervisor(3600.0)

    async def fail() -> dict[str, Any]:
        await asyncio.sleep(0.01)
        raise OSError("reset")

    async def run() -> None:
        broken = Request(request(supervisor).scope, fail)
        with pytest.raises(ProblemError, match="the client left"):
            await compute(broken, chores.add.job(1, 2))
        # What was cancelled for the client is not cancelled any more.
        await asyncio.sleep(0.01)

    asyncio.run(run())
    assert supervisor.cancelled
