"""Brief jobs, and the spare worker that does them while all others have work."""

import asyncio
import os
import signal

import pytest

from service.workers.state import DeadlineExceeded, QueueFull, WorkerCrashed
from service.workers.supervisor import WorkerSupervisor
from tests.service.workers.pools import chore, supervised, working

pytestmark = pytest.mark.anyio


@supervised(1, spares=1)
async def test_a_brief_job_is_done_while_all_workers_have_work_and_no_other_job_is(
    workers: WorkerSupervisor,
) -> None:
    assert (workers.count, workers.alive, workers.spare) == (1, 1, 1)
    running = asyncio.ensure_future(workers.submit(chore("nap", 20.0, seconds=60.0)))
    queued = asyncio.ensure_future(workers.submit(chore("nap", 0.0, seconds=60.0)))
    await asyncio.sleep(0)
    assert (workers.busy, workers.waiting) == (1, 1)
    answers = [workers.submit(chore("add", i, 1), brief=True) for i in range(20)]
    assert await asyncio.gather(*answers) == list(range(1, 21))
    assert not running.done()
    assert not queued.done(), "a spare worker takes nothing that may be long"
    running.cancel()
    assert await queued == 0.0


@supervised(1, spares=1)
async def test_brief_jobs_do_not_count_as_work(workers: WorkerSupervisor) -> None:
    nap = chore("nap", 20.0, seconds=60.0)
    brief = asyncio.ensure_future(workers.submit(nap, brief=True))
    await asyncio.sleep(0)
    assert (workers.busy, workers.busy_pids) == (0, [])
    assert await workers.submit(chore("add", 1, 2)) == 3
    assert not brief.done()
    brief.cancel()


@supervised(1, spares=1)
async def test_the_spare_worker_takes_the_place_of_one_that_dies(workers: WorkerSupervisor) -> None:
    first = set(workers.pids)
    dying = asyncio.ensure_future(workers.submit(chore("nap", 30.0)))
    waiting = asyncio.ensure_future(workers.submit(chore("surroundings")))
    await working(workers, 1)
    (victim,) = workers.busy_pids
    os.kill(victim, signal.SIGSEGV)  # as native code does it to itself
    assert {(await waiting)["pid"]} == first - {victim}, "none was started for it"
    with pytest.raises(WorkerCrashed):
        await dying
    async with asyncio.timeout(30.0):
        while not workers.ready or workers.spare != 1:
            await asyncio.sleep(0.01)
    assert len(set(workers.pids) - first) == 1


@supervised(1, spares=1)
async def test_a_worker_that_is_ended_leaves_its_job_to_the_spare_at_once(
    workers: WorkerSupervisor,
) -> None:
    first = set(workers.pids)
    with pytest.raises(DeadlineExceeded):
        await workers.submit(chore("burn", seconds=0.1))
    assert (await workers.submit(chore("surroundings")))["pid"] in first


@supervised(1, queue_limit=1, spares=1)
async def test_the_queue_of_brief_jobs_is_bounded(workers: WorkerSupervisor) -> None:
    jobs = [workers.submit(chore("nap", 0.2), brief=True) for _ in range(3)]
    accepted = [asyncio.ensure_future(job) for job in jobs]
    await asyncio.sleep(0)
    with pytest.raises(QueueFull):
        await workers.submit(chore("add", 1, 1), brief=True)
    assert await asyncio.gather(*accepted) == [0.2] * 3
