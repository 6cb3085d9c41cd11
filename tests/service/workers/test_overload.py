"""More work than workers: who is refused, who waits, and who goes first."""

import asyncio
import os
import signal
import time
from typing import Any

import pytest

from service.http.errors import headers_of, status_of
from service.workers.process import Background
from service.workers.state import DeadlineExceeded, QueueFull, WorkerCrashed
from service.workers.supervisor import WorkerSupervisor
from tests.service.processes import working_pids
from tests.service.workers.pools import chore, ready, supervised, supervisor, working
from tests.times import quickest

pytestmark = pytest.mark.anyio


def background(seconds: float = 20.0) -> Background:
    return Background(seconds, lambda: None)


async def learned(workers: WorkerSupervisor, seconds: float) -> None:
    """Let the supervisor know how long naps take."""
    await ready(workers)
    await asyncio.gather(*(workers.submit(chore("nap", seconds)) for _ in range(2)))


def test_what_cannot_end_before_its_deadline_is_refused_at_once() -> None:
    async def run() -> int:
        async with supervisor(2) as workers:
            await learned(workers, 0.2)
            naps: list[asyncio.Future[Any]] = []
            refused: list[QueueFull] = []
            for _ in range(30):
                naps.append(asyncio.ensure_future(workers.submit(chore("nap", 0.2, seconds=1.0))))
                await asyncio.sleep(0)
            for outcome in await asyncio.gather(*naps, return_exceptions=True):
                if isinstance(outcome, QueueFull):
                    refused.append(outcome)
                elif isinstance(outcome, BaseException):
                    assert isinstance(outcome, DeadlineExceeded), outcome
            served = 30 - len(refused) - workers.counters.overrun
            assert served <= 10, "ten fit into two workers for a second"
            assert workers.counters.rejected == len(refused)
            assert {status_of(problem) for problem in refused} == {429}
            assert {int(headers_of(problem)["Retry-After"]) for problem in refused} <= {1, 2}
            return 10 - served

    # At least seven, and nothing begun in vain, unless others have the processors every time.
    assert quickest(lambda: asyncio.run(run()), 4) <= 3


async def test_a_job_that_can_begin_at_once_is_never_refused() -> None:
    async with supervisor(1) as workers:
        await learned(workers, 0.3)
        assert await workers.submit(chore("nap", 0.0, seconds=0.1)) == 0.0


async def test_clients_take_turns(workers: WorkerSupervisor) -> None:
    ended: list[str] = []

    async def work(client: str) -> None:
        await workers.submit(chore("nap", 0.02), client=client)
        ended.append(client)

    many = [asyncio.ensure_future(work("many")) for _ in range(20)]
    await asyncio.sleep(0)
    few = [asyncio.ensure_future(work("few")) for _ in range(2)]
    await asyncio.gather(*many, *few)
    assert [i for i, client in enumerate(ended) if client == "few"][-1] <= 5


async def test_background_jobs_have_a_share_while_others_wait() -> None:
    async with supervisor(1, spares=1) as workers:
        await learned(workers, 0.05)
        served = 0

        async def ask() -> None:
            nonlocal served
            while True:
                await workers.submit(chore("nap", 0.05))
                served += 1

        asking = [asyncio.ensure_future(ask()) for _ in range(4)]
        await asyncio.sleep(0)
        async with asyncio.timeout(60.0):
            jobs = [workers.submit(chore("nap", 0.1), background=background()) for _ in "ab"]
            await asyncio.gather(*jobs)
        # A tenth of the time: two naps of 0.1 s beside 36 of 0.05 s.
        assert served < 80
        for client in asking:
            client.cancel()
        await asyncio.gather(*asking, return_exceptions=True)


@supervised(2, spares=1)
async def test_who_waits_is_served_beside_background_jobs(workers: WorkerSupervisor) -> None:
    jobs = [
        asyncio.ensure_future(workers.submit(chore("nap", 0.5), background=background()))
        for _ in range(8)
    ]
    await working(workers, 2)
    times = []
    for _ in range(10):
        start = time.monotonic()
        await workers.submit(chore("add", 1, 1))
        times.append(time.monotonic() - start)
        await asyncio.sleep(0.02)
    assert sorted(times)[5] < 0.2, "not when a nap is over"
    for job in jobs:
        job.cancel()
    await asyncio.gather(*jobs, return_exceptions=True)


async def test_a_job_whose_worker_is_killed_gets_a_second_attempt(
    workers: WorkerSupervisor,
) -> None:
    job = asyncio.ensure_future(workers.submit(chore("nap", 0.4), background=background()))
    await kill_when_busy(workers)
    assert await job == 0.4
    with pytest.raises(WorkerCrashed) as crashed:
        await workers.submit(chore("die"), background=background())
    assert crashed.value.details["causes"] == ["it was ended by SIGSEGV"] * 2


async def kill_when_busy(workers: WorkerSupervisor, earlier: int | None = None) -> int:
    """Kill a worker once it has a job and is not an earlier one; tells which it was."""
    # What has not reached its worker is sent to another one, which is no attempt.
    async with asyncio.timeout(20.0):
        while not (found := working_pids(workers) - {earlier}):
            await asyncio.sleep(0.005)
    (victim,) = found
    os.kill(victim, signal.SIGKILL)
    return victim


async def test_a_request_whose_worker_is_killed_gets_a_second_attempt(
    workers: WorkerSupervisor,
) -> None:
    nap = asyncio.ensure_future(workers.submit(chore("nap", 0.3)))
    await kill_when_busy(workers)
    assert await nap == 0.3
    assert workers.counters.crashed == 1
    burning = asyncio.ensure_future(workers.submit(chore("burn")))
    await kill_when_busy(workers, await kill_when_busy(workers))
    with pytest.raises(WorkerCrashed, match="so it did at the first attempt") as crashed:
        await burning
    assert crashed.value.details["causes"] == ["it was ended by SIGKILL"] * 2


async def test_a_request_that_ends_its_worker_by_itself_gets_no_second_attempt() -> None:
    async with supervisor(1) as workers:
        with pytest.raises(WorkerCrashed) as crashed:
            await workers.submit(chore("die"))
        assert "causes" not in crashed.value.details
        assert workers.counters.crashed == 1


async def test_a_second_attempt_has_the_time_that_is_left(workers: WorkerSupervisor) -> None:
    job = chore("burn", seconds=1.5)
    burning = asyncio.ensure_future(workers.submit(job))
    await kill_when_busy(workers)
    with pytest.raises(DeadlineExceeded, match="a second time") as late:
        await burning
    assert -10.0 < job.deadline.remaining <= 0.0, "it is still the first one"
    assert late.value.details["causes"] == ["it was ended by SIGKILL"]


class Notes:
    """A watch that writes down what it is told."""

    def __init__(self) -> None:
        self.told: list[str] = []

    def waits(self) -> None:
        self.told.append("waits")

    def begins(self) -> None:
        self.told.append("begins")

    def reaches(self, stage: str) -> None:
        self.told.append(stage)

    def ends(self, outcome: str) -> None:
        self.told.append(outcome)


def test_a_watch_is_told_of_the_whole_way_of_a_job() -> None:
    notes: dict[str, Notes] = {}

    def watch(task: str) -> Notes:
        return notes.setdefault(task.rpartition(":")[2], Notes())

    async def run() -> None:
        async with supervisor(1) as workers:
            workers.watcher = watch
            await workers.submit(chore("advance"))
            nap = asyncio.ensure_future(workers.submit(chore("nap", 0.3), background=background()))
            await kill_when_busy(workers)
            await nap
            waiting = asyncio.ensure_future(workers.submit(chore("echo", 1)))
            await asyncio.sleep(0)
            waiting.cancel()
            with pytest.raises(WorkerCrashed):
                await workers.submit(chore("die"))

    asyncio.run(run())
    steps = ["step_0", "step_1", "step_2", "step_3"]
    assert notes["advance"].told == ["begins", *steps, "finished"]
    assert [word for word in notes["nap"].told if word != "begins"] == ["waits", "finished"]
    assert notes["nap"].told[-2:] == ["begins", "finished"]
    assert notes["echo"].told[-1] == "cancelled"
    assert notes["die"].told == ["begins", "CRASH"]


def test_a_stopped_worker_has_no_grace() -> None:
    async def run() -> float:
        async with supervisor(1) as workers:
            await ready(workers)
            (worker,) = workers.pids
            os.kill(worker, signal.SIGSTOP)
            start = time.monotonic()
            job = chore("nap", 0.0, seconds=0.5)
            with pytest.raises(DeadlineExceeded, match="being computed"):
                await workers.submit(type(job)(job.task, job.args, {}, job.deadline, grace=2.0))
            took = time.monotonic() - start
            assert await workers.submit(chore("add", 1, 2)) == 3
            return took

    assert quickest(lambda: asyncio.run(run()), 0.8) < 0.8


async def test_the_cause_of_a_death_is_known_while_the_fork_server_is_busy(
    workers: WorkerSupervisor,
) -> None:
    parent = (await workers.submit(chore("surroundings")))["parent"]
    os.kill(parent, signal.SIGSTOP)
    try:
        with pytest.raises(WorkerCrashed, match="SIGSEGV"):
            await workers.submit(chore("die"))
    finally:
        os.kill(parent, signal.SIGCONT)
    assert await workers.submit(chore("add", 1, 2)) == 3
