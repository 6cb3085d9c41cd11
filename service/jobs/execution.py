"""The work on jobs: those that this process has, run by the application, and their ends stored.

What computes a job is the application itself, which is given the request once more: a job can do
whatever a request can, and nothing else.
"""

import asyncio
import contextlib
import logging
import time
from collections import deque
from collections.abc import Callable, Coroutine
from dataclasses import replace
from typing import Any, ParamSpec, TypeVar

from starlette.concurrency import run_in_threadpool
from starlette.types import ASGIApp

from service.access.caller import Caller
from service.http.errors import status_of
from service.http.state import JobContext
from service.jobs.live_job import (
    MAX_ATTEMPTS,
    LiveJob,
    lost_job,
    next_attempt,
    overdue_job,
    problem_answer,
)
from service.jobs.replay import Replayed, replay
from service.problem import ProblemError, unexpected_fault
from service.settings import Settings
from service.storage.database import StorageUnavailable
from service.storage.store import Store
from service.storage.stores.job_store import JobAnswer, JobRecord, JobStore, Status
from service.storage.stores.server_store import HEARTBEAT
from service.workers.faults import ShuttingDown

#: How often storage that can't be used is tried again [s].
STORAGE_RETRY = 0.5

P = ParamSpec("P")
R = TypeVar("R")


async def when_possible(call: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
    """The result of a call of the storage, as soon as the storage can be used."""
    while True:
        try:
            return await run_in_threadpool(call, *args, **kwargs)
        except StorageUnavailable:
            await asyncio.sleep(STORAGE_RETRY)


#: How often old answers are looked for [s].
_PERIOD = 60.0


async def purge(jobs: JobStore, settings: Settings) -> None:
    """Forget ended jobs that are too old or too many, if the storage can be used."""
    oldest = time.time() - settings.job_lifetime
    with contextlib.suppress(StorageUnavailable):
        await run_in_threadpool(jobs.purge, oldest, settings.job_count, settings.job_storage)


async def purge_periodically(jobs: JobStore, settings: Settings) -> None:
    """Forget old answers once in a while, until it is cancelled."""
    while True:
        await purge(jobs, settings)
        await asyncio.sleep(_PERIOD)


_log = logging.getLogger(__name__)
#: Batches that run at the same time; each keeps the workers busy by itself.
_BATCHES = 2
#: How much later than its deadline a job is ended that does not end itself [s].
_OVERRUN = 0.5
#: How often a shared database is told the progress of jobs, and asked which were cancelled [s].
_SHARING_PERIOD = 1.0
#: More than there ever are: a server that is alone takes over all jobs.
_ALL = 1_000_000
#: Requests of this path are batches.
BATCH_PATH = "/v1/plan/batch"


class JobExecution:
    """The jobs that this process waits for or works on.

    Args:
        app: Application that answers the requests.
        store: Store of the jobs.
        settings: Limits and lifetimes.
    """

    #: Jobs for agents that are worked on here at a time.
    _capacity = 0

    def __init__(self, app: ASGIApp, store: Store, settings: Settings) -> None:
        self._app = app
        self._store = store.jobs
        self._servers = store.servers
        self._server = store.server
        self._is_shared = not store.database.is_file
        self._settings = settings
        self._live: dict[str, LiveJob] = {}
        self._queues: dict[bool, deque[LiveJob]] = {False: deque(), True: deque()}
        self._running: dict[bool, int] = {False: 0, True: 0}
        self._limits = {False: settings.workers, True: _BATCHES}
        self._stopping = False
        self._chores: set[asyncio.Task[None]] = set()

    async def _end_work(self) -> None:
        """End the work on all jobs and give them back, and end the chores."""
        tasks = [live.task for live in self._live.values() if live.task is not None]
        for task in [*tasks, *self._chores]:
            task.cancel()
        await asyncio.gather(*tasks, *self._chores, return_exceptions=True)
        try:
            for live in list(self._live.values()):
                if not live.has_ended:
                    await run_in_threadpool(self._store.release, live.wait_again())
            await run_in_threadpool(self._servers.remove, self._server)
        except StorageUnavailable as problem:
            _log.warning("jobs could not be given back: %s", problem.detail)
        for live in self._live.values():
            if not live.has_ended:
                live.settle(live.wait_again(), None)
        self._live.clear()

    # ------------------------------------------------------------------------------ running

    def _enqueue(self, live: LiveJob) -> None:
        batch = live.record.path == BATCH_PATH
        self._queues[batch].append(live)
        self._start_next(batch)

    def _start_next(self, batch: bool) -> None:
        queue = self._queues[batch]
        while queue and self._running[batch] < self._limits[batch] and not self._stopping:
            live = queue.popleft()
            if live.is_ending:
                continue
            self._running[batch] += 1
            live.task = asyncio.create_task(self._run(live, batch))

    async def _run(self, live: LiveJob, batch: bool) -> None:
        try:
            await self._work(live)
        except ProblemError as problem:
            await self._finish(live, "failed", problem_answer(problem, live.record.path))
        except Exception:  # noqa: BLE001  (whatever it is, the job must end)
            mishap = unexpected_fault(f"job {live.record.id}")
            await self._finish(live, "failed", problem_answer(mishap, live.record.path))
        finally:
            self._running[batch] -= 1
            self._start_next(batch)

    async def _work(self, live: LiveJob) -> None:
        """Have a job answered, and store its end.

        Raises:
            ProblemError: That ends it.
        """
        replayed = await self._answer(live)
        if self._stopping and replayed.status == status_of(ShuttingDown()):
            return
        status: Status = "succeeded" if replayed.status < 400 else "failed"
        await self._finish(live, status, replayed.answer, replayed.headers.get("location"))

    async def _answer(self, live: LiveJob) -> Replayed:
        caller = Caller(live.record.tenant, live.record.api_key)
        context = JobContext(
            live.record.id,
            live.deadline,
            lambda: self._start(live),
            live.advance,
            caller,
            live.record.first or 0,
        )
        left = live.deadline + _OVERRUN - time.monotonic()
        try:
            async with asyncio.timeout(max(left, 0.0)):
                request = await when_possible(self._store.request, live.record.id)
                while True:
                    replayed = await replay(self._app, request, context)
                    if not replayed.is_storage_fault:
                        return replayed
                    await asyncio.sleep(STORAGE_RETRY)
        except TimeoutError:
            raise overdue_job(self._settings.job_deadline) from None

    def _start(self, live: LiveJob) -> None:
        if live.start():
            self._chore(self._save(live))

    async def _save(self, live: LiveJob) -> None:
        async with live.saving:
            if not live.has_ended:
                live.saved_event = live.record.event
                with contextlib.suppress(StorageUnavailable):  # the end is what counts
                    await run_in_threadpool(self._store.update, live.record)

    async def _finish(
        self, live: LiveJob, status: Status, answer: JobAnswer | None, location: str | None = None
    ) -> None:
        """Store the end of a job, as soon as that is possible, and tell of it then.

        Where it was cancelled meanwhile, or another server took it over, that counts.
        """
        async with live.saving:
            if live.has_ended:
                return
            record = live.last_record(status, location)
            if not await when_possible(self._store.update, record, answer):
                record, answer = await self._stored_end(record)
            live.settle(record, answer)
        self._live.pop(live.record.id, None)
        await self._forget_old()

    async def _stored_end(self, record: JobRecord) -> tuple[JobRecord, JobAnswer | None]:
        """The job as the database has it; one that is not there any more was cancelled."""
        try:
            return await when_possible(self._store.get, record.id)
        except ProblemError:
            return replace(record, status="cancelled"), None

    async def _forget_old(self) -> None:
        await purge(self._store, self._settings)

    # ------------------------------------------------------------------------ other servers

    async def _adopt(self) -> None:
        """Queue jobs whose server is dead."""
        room = max(self._settings.job_limit - len(self._live), 0) if self._is_shared else _ALL
        for record in await run_in_threadpool(self._store.adopt, room):
            if record.id not in self._live:
                await self._take(record, self._deadline())

    async def _take(self, record: JobRecord, deadline: float) -> LiveJob:
        """Queue a job that no other server has; if it has lost its last attempt, it has failed."""
        ran = record.status == "running"
        live = LiveJob(next_attempt(record) if ran else record, deadline, 0)
        live.stored = True
        self._live[record.id] = live
        if live.record.attempt > MAX_ATTEMPTS:
            problem = problem_answer(lost_job(), record.path)
            await self._finish(live, "failed", problem)
            return live
        if ran:
            await self._save(live)
        self._enqueue(live)
        return live

    async def _share_periodically(self) -> None:
        beaten = time.monotonic()
        while True:
            await asyncio.sleep(_SHARING_PERIOD)
            with contextlib.suppress(StorageUnavailable):
                if time.monotonic() - beaten >= HEARTBEAT:
                    beaten = time.monotonic()
                    if not await run_in_threadpool(self._servers.beat, self._server):
                        await run_in_threadpool(
                            self._servers.register, self._server, self._capacity
                        )
                    await self._adopt()
                await self._drop_lost()
                for live in list(self._live.values()):
                    if live.record.status == "running" and live.record.event != live.saved_event:
                        await self._save(live)

    async def _drop_lost(self) -> None:
        """Stop the work on jobs that were cancelled elsewhere, or that others have taken over."""
        ids = [live.record.id for live in self._live.values() if live.stored]
        for job_id in await run_in_threadpool(self._store.taken_away, ids):
            live = self._live.get(job_id)
            if live is None or live.has_ended:
                continue
            if live.task is not None:
                live.task.cancel()
            # Nothing of this is kept: the database tells how the job has really ended.
            await self._finish(live, "cancelled", None)

    # ------------------------------------------------------------------------------- chores

    def _deadline(self) -> float:
        return time.monotonic() + self._settings.job_deadline

    def _chore(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.create_task(work)
        self._chores.add(task)
        task.add_done_callback(self._chores.discard)
        return task
