"""Memory and age of workers: requests that want too much, and workers that are replaced."""

import asyncio

import pytest

from service.problem import ProblemError
from service.workers.process import MemoryMeter, WorkerLimits
from tests.service.workers.pools import chore, ready, supervisor

MEBIBYTE = 2**20
LIMITS = WorkerLimits(memory=256 * MEBIBYTE, growth=64 * MEBIBYTE, jobs=5, age=3600.0)


def test_a_request_that_wants_too_much_memory_is_told_and_costs_its_worker_only() -> None:
    async def run() -> None:
        async with supervisor(1, limits=LIMITS) as workers:
            await ready(workers)
            (pid,) = workers.pids
            with pytest.raises(ProblemError, match="more memory") as refused:
                await workers.submit(chore("hoard", 512 * MEBIBYTE))
            assert refused.value.code == "OUT_OF_MEMORY"
            assert refused.value.hint
            assert await workers.submit(chore("add", 1, 2)) == 3
            assert workers.pids != [pid], "another worker takes its place"

    asyncio.run(run())


def test_a_worker_that_has_grown_is_replaced() -> None:
    async def run() -> None:
        async with supervisor(1, limits=LIMITS) as workers:
            await ready(workers)
            pids = [await workers.submit(chore("hoard", 24 * MEBIBYTE)) for _ in range(6)]
            assert pids[0] == pids[1] == pids[2] != pids[3], "72 MiB are above 64"
            await asyncio.sleep(0)  # who waited for the answer came first
            assert workers.counters.recycled == 2
            assert MemoryMeter(pids[0]).resident == 0

    asyncio.run(run())


def test_a_worker_is_replaced_after_its_jobs_and_at_its_age() -> None:
    async def run(limits: WorkerLimits, expected: int) -> None:
        async with supervisor(1, limits=limits) as workers:
            await ready(workers)
            pids = {await workers.submit(chore("hoard", 1)) for _ in range(10)}
            assert len(pids) == expected

    asyncio.run(run(LIMITS, 2))
    asyncio.run(run(LIMITS._replace(jobs=1000, age=0.0), 10))
    asyncio.run(run(LIMITS._replace(jobs=1000), 1))
