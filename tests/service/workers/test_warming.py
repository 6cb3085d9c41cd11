"""Workers that warm up, and the process that they are forked from."""

import asyncio
import os
import signal
import time

import pytest

from service.workers.faults import DeadlineExceeded
from tests.service.workers.pools import chore, ready, supervisor, working


def test_workers_that_cannot_warm_up_are_never_ready(caplog: pytest.LogCaptureFixture) -> None:
    async def run() -> None:
        async with supervisor(1, warm="failing_warming") as workers:
            async with asyncio.timeout(60.0):
                while "no compiler" not in caplog.text:
                    await asyncio.sleep(0.01)
            assert not workers.ready
            with pytest.raises(DeadlineExceeded):
                await workers.submit(chore("add", 1, 1, seconds=0.1))

    asyncio.run(run())


def test_progress_of_warming_is_told_until_it_ends() -> None:
    async def run() -> None:
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

    asyncio.run(run())


def test_a_fork_server_that_dies_is_replaced_and_costs_no_job() -> None:
    async def run() -> None:
        async with supervisor(1) as workers:
            await ready(workers)
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

    asyncio.run(run())


def test_the_twin_of_a_fork_server_takes_its_place_at_once() -> None:
    async def run() -> None:
        async with supervisor(2) as workers:
            await ready(workers)
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

    asyncio.run(run())


def test_readiness_is_the_truth_while_there_is_no_worker() -> None:
    async def run() -> None:
        async with supervisor(2) as workers:
            await ready(workers)
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

    asyncio.run(run())


def test_workers_are_forked_anew_once_more_is_prepared() -> None:
    async def run() -> None:
        async with supervisor(1, spares=1, enrich="enriching") as workers:
            await ready(workers)
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

    asyncio.run(run())


def test_a_worker_that_dies_while_more_is_prepared_is_replaced() -> None:
    async def run() -> None:
        async with supervisor(1, enrich="enriching") as workers:
            await ready(workers)
            (victim,) = workers.pids
            os.kill(victim, signal.SIGKILL)
            assert await workers.submit(chore("add", 1, 1)) == 2

    asyncio.run(run())


def test_workers_do_without_what_could_not_be_prepared() -> None:
    async def run() -> None:
        async with supervisor(1, enrich="failing_enriching") as workers:
            await ready(workers)
            async with asyncio.timeout(30.0):
                while workers.started_workers < 2:
                    await asyncio.sleep(0.02)
            assert await workers.submit(chore("enriched")) == [0]

    asyncio.run(run())
