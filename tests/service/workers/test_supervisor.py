"""Supervised workers: jobs, faults, overruns, more work than workers, and shutdown."""

import asyncio
import contextlib
import math
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from planning.values.deadline import Deadline
from service.http.errors import document, headers_of, status_of
from service.storage.caches.cache_key import builtin_reference
from service.validation import ProblemError
from service.workers.process import Background
from service.workers.result import CacheMiss, TaskProblem
from service.workers.state import DeadlineExceeded, QueueFull, ShuttingDown, WorkerCrashed
from service.workers.supervisor import WorkerSupervisor
from service.workers.task import Job, load_tasks, registered_task
from tests.service import chores
from tests.service.processes import alive, wait_until, working_pids
from tests.service.workers.pools import chore, ready, supervised, supervisor, working
from tests.times import quickest

pytestmark = pytest.mark.anyio

ROOT = Path(__file__).parents[3]


async def test_results_and_large_payloads() -> None:
    async with supervisor() as workers:
        assert not workers.ready
        assert await workers.submit(chore("add", 2, b=3, seconds=60.0)) == 5
        await ready(workers)
        large = random.Random(0).randbytes(10_000_000)
        assert await workers.submit(chore("echo", large)) == large
        answers = await asyncio.gather(*(workers.submit(chore("add", i, i)) for i in range(200)))
        assert answers == [2 * i for i in range(200)]


async def test_workers_are_single_threaded_and_know_their_deadline(
    workers: WorkerSupervisor,
) -> None:
    facts = await workers.submit(chore("surroundings"))
    assert set(facts["threads"].values()) == {"1"}
    assert {"OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"} <= set(facts["threads"])
    assert facts["numba"] == 1
    assert facts["pid"] in workers.pids
    assert 4.5 < await workers.submit(chore("remaining", seconds=5.0)) <= 5.0
    assert await workers.submit(chore("remaining", seconds=math.inf)) == math.inf


async def test_faults_cross_as_values_and_bugs_leak_nothing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with supervisor(1) as workers:
        with pytest.raises(ProblemError) as fault:
            await workers.submit(chore("blame_caller", seconds=60.0))
        told = document(fault.value, "/x")
        assert told | {
            "code": "INVALID_LINK_NAME", "status": 422, "detail": "no link 'x'",
            "hint": "Choose 'a' or 'b'.", "details": {"link": "x", "choices": ["a", "b"]},
        } == told  # fmt: skip
        first = workers.pids
        for name in ("stumble", "unpicklable", "no_such_chore"):
            with pytest.raises(ProblemError) as bug:
                await workers.submit(chore(name))
            told = document(bug.value, "/x")
            assert (told["code"], told["status"]) == ("CRASH", 500)
            assert "secret" not in str(told)
            assert told["details"]["reference"] in caplog.text
        assert "a secret" in caplog.text
        assert workers.pids == first, "an exception must not cost a worker"


def test_the_mean_duration_is_that_of_work() -> None:
    """Requests that were refused before anything was computed would make others look quick."""
    refused = [
        TaskProblem("VALIDATION_ERROR", "seed: too small", None, {}),
        CacheMiss(builtin_reference("panda")),
    ]
    failed = TaskProblem("PLANNING_FAILED", "no path", None, {})

    async def run() -> None:
        async with supervisor(1) as workers:
            await ready(workers)
            for outcome in refused:
                assert await workers.submit(chore("echo", outcome)) == outcome
            with pytest.raises(ProblemError):
                await workers.submit(chore("blame_caller"))
            unknown = workers.durations.mean("none")
            for name in ("echo", "blame_caller"):
                assert workers.durations.mean(f"tests.service.chores:{name}") == unknown
            assert await workers.submit(chore("echo", failed)) == failed
            assert workers.durations.mean("tests.service.chores:echo") < unknown
            assert workers.counters.finished == 4

    asyncio.run(run())


@pytest.mark.parametrize(
    "name",
    ["os:system", "tests.service.chores:os", "tests.service.chores:no_warming", "", "plan",
     "service.endpoints.plan.task:_late"],
)  # fmt: skip
def test_only_registered_functions_are_tasks(name: str) -> None:
    load_tasks("tests.service.chores")
    with pytest.raises(LookupError, match="not a registered task"):
        registered_task(name)
    assert registered_task("tests.service.chores:add") is chores.add

    async def run() -> None:
        async with supervisor(1) as workers:
            job: Job[Any] = Job(name)
            with pytest.raises(ProblemError) as fault:
                await workers.submit(job.with_deadline(Deadline.after(60.0)))
            assert fault.value.code == "CRASH"

    asyncio.run(run())


async def test_progress_is_passed_on() -> None:
    seen: list[tuple[float, str]] = []
    async with supervisor(1) as workers:
        result = await workers.submit(
            chore("advance", seconds=60.0), lambda share, stage: seen.append((share, stage))
        )
    assert result == "done"
    assert seen == [(0.0, "step_0"), (0.25, "step_1"), (0.5, "step_2"), (0.75, "step_3")]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV, signal.SIGABRT])
@supervised(2)
async def test_a_crash_is_told_and_noticed_by_nobody_else(
    workers: WorkerSupervisor, number: signal.Signals
) -> None:
    neighbour = asyncio.ensure_future(workers.submit(chore("nap", 0.3)))
    with pytest.raises(WorkerCrashed, match=number.name):
        await workers.submit(chore("die", int(number)))
    assert await neighbour == 0.3
    assert await workers.submit(chore("add", 1, 1)) == 2
    # What ends by SIGKILL may have been killed by others: it is begun once more.
    assert workers.counters.crashed == (2 if number == signal.SIGKILL else 1)


@supervised(2)
async def test_an_idle_worker_that_dies_is_replaced_and_costs_no_request(
    workers: WorkerSupervisor,
) -> None:
    before = set(workers.pids)
    for pid in before:
        os.kill(pid, signal.SIGKILL)
    answers = [workers.submit(chore("add", i, 0)) for i in range(10)]
    assert await asyncio.gather(*answers) == list(range(10))
    assert not before & set(workers.pids)


async def test_no_job_is_lost_under_a_storm_of_kills() -> None:
    random_source = random.Random(3)
    async with supervisor(2) as workers:
        await ready(workers)
        jobs = [
            asyncio.ensure_future(workers.submit(chore("nap", 0.01, seconds=60.0)))
            for _ in range(400)
        ]
        kills = 0
        while kills < 100 and not all(job.done() for job in jobs):
            with contextlib.suppress(ProcessLookupError, IndexError):
                os.kill(random_source.choice(workers.pids), signal.SIGKILL)
                kills += 1
            await asyncio.sleep(random_source.uniform(0.0, 0.07))
        results = await asyncio.gather(*jobs, return_exceptions=True)
        crashed = sum(isinstance(result, WorkerCrashed) for result in results)
        assert crashed + results.count(0.01) == 400
        assert crashed <= kills // 2, "each was begun twice"
        assert workers.counters.crashed >= 1
        assert kills > 50
        assert await workers.submit(chore("add", 1, 1)) == 2
        async with asyncio.timeout(10.0):
            while len(workers.pids) != 2:
                await asyncio.sleep(0.01)


@pytest.mark.parametrize("name", ["nap", "burn"])
def test_an_overrun_is_ended_within_three_tenths_of_a_second(name: str) -> None:
    async def run() -> float:
        async with supervisor(1) as workers:
            await ready(workers)
            victim = workers.pids[0]
            start = time.monotonic()
            with pytest.raises(DeadlineExceeded) as error:
                await workers.submit(chore(name, *([30.0] if name == "nap" else []), seconds=0.2))
            assert wait_until(lambda: not alive(victim), 20.0)
            took = time.monotonic() - start
            assert status_of(error.value) == 504
            assert error.value.code == "TIMED_OUT"
            assert await workers.submit(chore("add", 1, 2)) == 3
            return took

    assert 0.2 <= quickest(lambda: asyncio.run(run()), 0.5) < 0.5


def test_what_was_found_is_answered_when_time_is_up() -> None:
    async def run() -> float:
        async with supervisor(1) as workers:
            await ready(workers)
            start = time.monotonic()
            found = await workers.submit(chore("search", 0.05, seconds=0.6))
            took = time.monotonic() - start
            assert found.startswith("found ")
            assert int(found.removeprefix("found ")) > 0, "a later one took the place of the first"
            assert await workers.submit(chore("add", 1, 2)) == 3
            return took

    assert 0.6 <= quickest(lambda: asyncio.run(run()), 0.9) < 0.9


async def test_what_a_worker_has_found_outlives_it(workers: WorkerSupervisor) -> None:
    assert await workers.submit(chore("find_and_die", seconds=20.0)) == "found"
    # One that is stopped in the midst of its work is starved of all its time.
    job = asyncio.ensure_future(workers.submit(chore("search", 0.05, seconds=1.5)))
    await working(workers, 1)
    await asyncio.sleep(0.5)
    os.kill(workers.busy_pids[0], signal.SIGSTOP)
    assert (await job).startswith("found ")


async def test_small_requests_wait_behind_large_ones_where_there_is_time(
    workers: WorkerSupervisor,
) -> None:
    await workers.submit(chore("nap_over", 1.0, b"x" * 100_000))
    large = asyncio.ensure_future(workers.submit(chore("nap_over", 0.3, b"x" * 100_000)))
    await working(workers, 1)
    jobs = [
        asyncio.ensure_future(workers.submit(chore("nap_over", 0.01, b"x" * 500, seconds=5.0)))
        for _ in range(6)
    ]
    assert await asyncio.gather(*jobs) == [500] * 6
    await large


async def test_a_job_whose_deadline_passes_in_the_queue_never_runs(
    workers: WorkerSupervisor,
) -> None:
    busy = asyncio.ensure_future(workers.submit(chore("nap", 20.0, seconds=60.0)))
    await working(workers, 1)
    with pytest.raises(DeadlineExceeded, match="waiting for a worker"):
        await workers.submit(chore("nap", 0.0, seconds=0.3))
    assert not busy.done(), "the job that ran is not touched"
    assert workers.busy == 1
    busy.cancel()


@supervised(2, queue_limit=3)
async def test_the_queue_is_bounded(workers: WorkerSupervisor) -> None:
    accepted = [asyncio.ensure_future(workers.submit(chore("nap", 0.2))) for _ in range(5)]
    await asyncio.sleep(0)
    assert (workers.busy, workers.waiting) == (2, 3)
    with pytest.raises(QueueFull) as error:
        await workers.submit(chore("add", 1, 1))
    assert status_of(error.value) == 429
    assert error.value.code == "OVERLOADED"
    assert int(headers_of(error.value)["Retry-After"]) >= 1
    assert await asyncio.gather(*accepted) == [0.2] * 5
    assert await workers.submit(chore("add", 1, 1)) == 2


async def test_cancelling_takes_a_job_from_the_queue_or_ends_its_worker(
    workers: WorkerSupervisor,
) -> None:
    victim = workers.pids[0]
    running = asyncio.ensure_future(workers.submit(chore("burn")))
    await working(workers, 1)
    queued = asyncio.ensure_future(workers.submit(chore("burn")))
    await asyncio.sleep(0.02)
    assert workers.waiting == 1
    queued.cancel()
    await asyncio.sleep(0.02)
    assert workers.waiting == 0
    assert alive(victim)
    running.cancel()
    assert await asyncio.to_thread(wait_until, lambda: not alive(victim), 10.0)
    assert await workers.submit(chore("add", 1, 1)) == 2
    assert workers.counters.cancelled == 2


async def test_a_worker_that_was_ended_is_not_listed_while_it_is_reaped(
    workers: WorkerSupervisor,
) -> None:
    (victim,) = workers.pids
    running = asyncio.ensure_future(workers.submit(chore("burn")))
    await working(workers, 1)
    assert workers.busy_pids == [victim]
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    assert victim not in workers.pids
    assert workers.busy_pids == []
    assert await workers.submit(chore("add", 1, 1)) == 2


@supervised(2)
async def test_stopping_tells_everybody_and_leaves_nothing_behind(
    workers: WorkerSupervisor,
) -> None:
    pids = workers.pids
    jobs = [asyncio.ensure_future(workers.submit(chore("burn"))) for _ in range(5)]
    await working(workers, 2)
    start = time.monotonic()
    await workers.stop()
    assert time.monotonic() - start < 10.0, "not when they are done"
    results = await asyncio.gather(*jobs, return_exceptions=True)
    assert all(isinstance(result, ShuttingDown) for result in results)
    assert not any(alive(pid) for pid in pids)
    with pytest.raises(ShuttingDown):
        await workers.submit(chore("add", 1, 1))


_DOOMED_SERVER = """
import asyncio, time
from planning.values.deadline import Deadline
from service.workers.fork.launch import Recipe
from service.workers.task import Job
from service.workers.supervisor import WorkerSupervisor
from tests.service import chores

async def main():
    workers = WorkerSupervisor(
        2, 10, recipe=Recipe(("tests.service.chores",), "tests.service.chores:no_warming")
    )
    await workers.start()
    while not workers.ready:
        await asyncio.sleep(0.01)
    job = workers.submit(chores.burn.job().with_deadline(Deadline.after(600.0)))
    task = asyncio.ensure_future(job)
    while not workers.busy:
        await asyncio.sleep(0.01)
    await asyncio.sleep(0.2)
    print(*workers.pids, flush=True)
    await task

asyncio.run(main())
"""


def test_no_worker_outlives_a_server_that_is_killed() -> None:
    command = [sys.executable, "-c", _DOOMED_SERVER]
    with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=ROOT, text=True) as server:
        assert server.stdout is not None
        pids = [int(word) for word in server.stdout.readline().split()]
        assert len(pids) == 2
        assert all(alive(pid) for pid in pids)
        server.kill()
    assert wait_until(lambda: not any(alive(pid) for pid in pids), 20.0), "one of them was busy"


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
