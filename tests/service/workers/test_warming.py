"""Workers that warm up or are replaced, and the process that they are forked from."""

import asyncio
import os
import signal
import time

import pytest

from service.validation import ProblemError
from service.workers.process import Memory, WorkerLimits
from service.workers.state import DeadlineExceeded
from service.workers.supervisor import WorkerSupervisor
from tests.service.workers.pools import chore, ready, supervised, supervisor, working

pytestmark = pytest.mark.anyio


async def test_workers_that_cannot_warm_up_are_never_ready(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with supervisor(1, warm="failing_warming") as workers:
        async with asyncio.timeout(60.0):
            while "no compiler" not in caplog.text:
                await asyncio.sleep(0.01)
        assert not workers.ready
        with pytest.raises(DeadlineExceeded):
            await workers.submit(chore("add", 1, 1, seconds=0.1))


async def test_progress_of_warming_is_told_until_it_ends() -> None:
    async with supervisor(1, warm="slow_warming") as workers:
        assert workers.progress is None
        async with asyncio.timeout(30.0):
            while workers.progress is None or workers.progress.done == 0:
                await asyncio.sleep(0.01)
        assert workers.progress == (1, 2, 30.4)
        assert not workers.ready
        start = time.monotonic()
        await workers.stop()
        assert time.monotonic() - start < 10.0, "it would warm up for hours"


async def test_a_fork_server_that_dies_is_replaced_and_costs_no_job(
    workers: WorkerSupervisor,
) -> None:
    before = await workers.submit(chore("surroundings"))
    running = asyncio.ensure_future(workers.submit(chore("nap", 0.3)))
    await working(workers, 1)
    os.kill(before["parent"], signal.SIGKILL)
    assert await running == 0.3
    (worker,) = workers.pids
    assert worker == before["pid"], "workers outlive it"
    os.kill(worker, signal.SIGKILL)
    after = await workers.submit(chore("surroundings"))
    assert after["parent"] != before["parent"]


@supervised(2)
async def test_the_twin_of_a_fork_server_takes_its_place_at_once(workers: WorkerSupervisor) -> None:
    times = []
    for _ in range(3):
        parent = (await workers.submit(chore("surroundings")))["parent"]
        async with asyncio.timeout(20.0):
            while workers._pool._twin is None:
                await asyncio.sleep(0.01)
        began = time.monotonic()
        for pid in (parent, *workers.pids):
            os.kill(pid, signal.SIGKILL)
        await asyncio.sleep(0.01)
        after = await workers.submit(chore("surroundings"))
        times.append(time.monotonic() - began)
        assert after["parent"] != parent
        await ready(workers)
        # A service that runs for months keeps nothing of the twins that have ended.
        assert len(workers._pool._lost) == 1
    assert min(times) < 1.0, "others may have the processors now and then"


@supervised(2)
async def test_readiness_is_the_truth_while_there_is_no_worker(workers: WorkerSupervisor) -> None:
    parent = (await workers.submit(chore("surroundings")))["parent"]
    os.kill(parent, signal.SIGSTOP)  # nobody replaces them
    for pid in workers.pids:
        os.kill(pid, signal.SIGKILL)
    async with asyncio.timeout(20.0):
        while workers.ready:
            await asyncio.sleep(0.005)
    await asyncio.sleep(0.1)
    assert not workers.ready
    os.kill(parent, signal.SIGCONT)
    await ready(workers)


@supervised(1, spares=1, enrich="enriching")
async def test_workers_are_forked_anew_once_more_is_prepared(workers: WorkerSupervisor) -> None:
    first = set(workers.pids)
    running = asyncio.ensure_future(workers.submit(chore("nap", 60.0, seconds=90.0)))
    async with asyncio.timeout(30.0):
        while await workers.submit(chore("enriched"), brief=True) != [0, 1, 2]:
            await asyncio.sleep(0.02)
    assert len(first & set(workers.pids)) == 1, "one that has a job is left alone"
    assert not running.done()
    assert not workers.settled
    running.cancel()
    async with asyncio.timeout(30.0):
        while not workers.settled or workers.spare != 1:
            await asyncio.sleep(0.02)
    assert not first & set(workers.pids)
    assert await workers.submit(chore("enriched")) == [0, 1, 2]
    assert workers.counters.crashed == 0


@supervised(1, enrich="enriching")
async def test_a_worker_that_dies_while_more_is_prepared_is_replaced(
    workers: WorkerSupervisor,
) -> None:
    (victim,) = workers.pids
    os.kill(victim, signal.SIGKILL)
    assert await workers.submit(chore("add", 1, 1)) == 2


@supervised(1, enrich="failing_enriching")
async def test_workers_do_without_what_could_not_be_prepared(workers: WorkerSupervisor) -> None:
    async with asyncio.timeout(30.0):
        while workers.started_workers < 2:
            await asyncio.sleep(0.02)
    assert await workers.submit(chore("enriched")) == [0]


MEBIBYTE = 2**20
LIMITS = WorkerLimits(memory=256 * MEBIBYTE, growth=64 * MEBIBYTE, jobs=5, age=3600.0)


@supervised(1, limits=LIMITS)
async def test_a_request_that_wants_too_much_memory_is_told_and_costs_its_worker_only(
    workers: WorkerSupervisor,
) -> None:
    (pid,) = workers.pids
    with pytest.raises(ProblemError, match="more memory") as refused:
        await workers.submit(chore("hoard", 512 * MEBIBYTE))
    assert refused.value.code == "OUT_OF_MEMORY"
    assert refused.value.hint
    assert await workers.submit(chore("add", 1, 2)) == 3
    assert workers.pids != [pid], "another worker takes its place"


@supervised(1, limits=LIMITS)
async def test_a_worker_that_has_grown_is_replaced(workers: WorkerSupervisor) -> None:
    pids = [await workers.submit(chore("hoard", 24 * MEBIBYTE)) for _ in range(6)]
    assert pids[0] == pids[1] == pids[2] != pids[3], "72 MiB are above 64"
    await asyncio.sleep(0)  # who waited for the answer came first
    assert workers.counters.recycled == 2
    assert Memory.of(pids[0]) == (0, 0)


def test_a_worker_is_replaced_after_its_jobs_and_at_its_age() -> None:
    async def run(limits: WorkerLimits, expected: int) -> None:
        async with supervisor(1, limits=limits) as workers:
            await ready(workers)
            pids = {await workers.submit(chore("hoard", 1)) for _ in range(10)}
            assert len(pids) == expected

    asyncio.run(run(LIMITS, 2))
    asyncio.run(run(LIMITS._replace(jobs=1000, age=0.0), 10))
    asyncio.run(run(LIMITS._replace(jobs=1000), 1))
