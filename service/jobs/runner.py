"""Jobs: requests that are stored, answered when their turn comes, and asked for later.

A job is a stored request and, in the end, its answer. What computes it is the application itself,
which is given the request once more: a job can do whatever a request can, and nothing else.
"""

import asyncio
import contextlib
import logging
import re
import time
from collections import deque
from collections.abc import AsyncIterator, Coroutine
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.types import ASGIApp

from service.access.caller import ANYONE, Caller
from service.http.errors import status_of
from service.http.job_context import JobContext
from service.jobs import records, storage_retry
from service.jobs.event_stream import follow_live, follow_stored
from service.jobs.live_job import LiveJob
from service.jobs.purge import purge, purge_periodically
from service.jobs.replay import Replayed, replay
from service.jobs.storage_retry import when_possible
from service.problem import ProblemError, unexpected_fault
from service.settings import Settings
from service.storage.database import StorageUnavailable
from service.storage.idempotency_store import KeptAnswer
from service.storage.job_store import (
    ENDED,
    JobAnswer,
    JobRecord,
    Status,
    StoredRequest,
    no_job,
)
from service.storage.server_store import HEARTBEAT
from service.storage.store import Store
from service.workers.faults import JobsFull, ShuttingDown

_log = logging.getLogger(__name__)
_ID = re.compile(r"[0-9a-f]{32}")
#: Batches that run at the same time; each keeps the workers busy by itself.
_BATCHES = 2
#: How much later than its deadline a job is ended that does not end itself [s].
_OVERRUN = 0.5
#: How often a shared database is told the progress of jobs, and asked which were cancelled [s].
_SHARING_PERIOD = 1.0
_BATCH_PATH = "/v1/plan/batch"

#: Longest time that who cancels a job waits for the storage [s].
_CANCEL_TIMEOUT = 5.0
#: More than there ever are: a server that is alone takes over all jobs.
_ALL = 1_000_000


class Jobs:
    """All jobs of the service.

    Args:
        app: What answers the requests.
        store: Where jobs are kept.
        settings: Limits and lifetimes.
    """

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
        self._closing = asyncio.Event()
        self._chores: set[asyncio.Task[None]] = set()

    # ------------------------------------------------------------------------- life of all

    async def start(self) -> None:
        """Queue the jobs that waited or ran when their server ended."""
        await run_in_threadpool(self._servers.register, self._server)
        await self._adopt()
        self._chore(purge_periodically(self._store, self._settings))
        if self._is_shared:
            self._chore(self._share_periodically())

    async def stop(self) -> None:
        """Accept no more jobs; those that run will be queued when the service starts again."""
        self._stopping = True
        self._closing.set()
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
        self._live.clear()

    @property
    def unfinished_count(self) -> int:
        """Jobs that wait or run."""
        return len(self._live)

    # ------------------------------------------------------------------------- life of one

    def check_room(self, size: int, caller: Caller = ANYONE) -> None:
        """See whether a request of a size [byte] of a caller would be accepted.

        Raises:
            JobsFull: As many jobs as are allowed wait or run.
            ShuttingDown: The service is about to end.
        """
        if self._stopping:
            raise ShuttingDown
        own = sum(live.record.api_key == caller.api_key for live in self._live.values())
        if caller.job_limit is not None and own >= caller.job_limit:
            raise JobsFull(own, self._settings.workers)
        waiting = sum(live.size for live in self._live.values())
        if len(self._live) >= self._settings.job_limit or (
            waiting + size > self._settings.job_storage and self._live
        ):
            raise JobsFull(len(self._live), self._settings.workers)

    async def accept(
        self,
        request: StoredRequest,
        told: KeptAnswer[JobRecord] | None = None,
        caller: Caller = ANYONE,
    ) -> JobRecord:
        """Make a job of a request that was checked.

        Args:
            request: The request.
            told: What its idempotency key stands for from then on.
            caller: Whose job it is.

        Raises:
            ProblemError: As `check_room`; STORAGE_UNAVAILABLE.
        """
        self.check_room(len(request.body), caller)
        live = LiveJob(records.new_record(request, caller), self._deadline(), len(request.body))
        self._live[live.record.id] = live
        try:
            await run_in_threadpool(self._store.add, live.record, request, told)
        except BaseException:
            del self._live[live.record.id]
            raise
        live.stored = True
        accepted = live.record
        self._enqueue(live)
        return accepted

    async def keep(
        self,
        request: StoredRequest,
        answer: JobAnswer,
        location: str | None,
        told: KeptAnswer[JobRecord] | None = None,
        caller: Caller = ANYONE,
    ) -> JobRecord:
        """Make a job of a request that was answered already.

        Args:
            request: The request.
            answer: Its answer.
            location: What it created.
            told: What its idempotency key stands for from then on.
            caller: Whose job it is.

        Raises:
            ProblemError: STORAGE_UNAVAILABLE; the service is about to end.
        """
        if self._stopping:
            raise ShuttingDown
        live = LiveJob(records.new_record(request, caller), self._deadline(), 0)
        live.start()
        live.end("succeeded", answer, location)
        await run_in_threadpool(self._store.add, live.record, answer, told)
        return live.record

    async def get(self, job_id: str) -> tuple[JobRecord, JobAnswer | None]:
        """A job, and its answer once there is one.

        Raises:
            ProblemError: NOT_FOUND.
        """
        live = self._live.get(job_id)
        if live is not None:
            return live.record, live.answer
        if not _ID.fullmatch(job_id):
            raise no_job(job_id)
        return await run_in_threadpool(self._store.get, job_id)

    async def list(
        self, status: Status | None, before: str, limit: int, tenant: str | None = None
    ) -> list[JobRecord]:
        """Jobs of a tenant or of all, before one of an id, newest first, as they stand now."""
        stored = await run_in_threadpool(self._store.list, status, before, limit, tenant)
        return [self._live[r.id].record if r.id in self._live else r for r in stored]

    async def cancel(self, job_id: str) -> JobRecord:
        """End a job; one that was cancelled before stays so.

        Raises:
            ProblemError: NOT_FOUND; CONFLICT, it has ended already.
        """
        live = self._live.get(job_id)
        if live is not None and not live.has_ended:
            await self._cancel_live(live)
            record = live.record
        else:
            record, _ = await self.get(job_id)
            if record.status not in ENDED:  # another server works on it
                cancelled = await run_in_threadpool(self._store.cancel, job_id, time.time())
                record = cancelled or (await self.get(job_id))[0]
        if record.status == "cancelled":
            return record
        raise ProblemError(
            "CONFLICT",
            f"job {job_id} has ended already: it {record.status}",
            stage="job",
            hint="There is nothing to cancel; GET it for its answer.",
            status_of_job=record.status,
        )

    async def _cancel_live(self, live: LiveJob) -> None:
        """End a job of this server: its work at once, and the job once that is stored."""
        if live.task is not None:
            live.task.cancel()
        ending = self._chore(self._finish(live, "cancelled", None))
        await asyncio.wait({ending}, timeout=_CANCEL_TIMEOUT)
        if not live.has_ended:
            raise StorageUnavailable("the job is ended as soon as that can be stored")

    async def events(self, job_id: str, after: int) -> AsyncIterator[bytes] | None:
        """The events of a job after one of a number, as they come; None if there are no more.

        Raises:
            ProblemError: NOT_FOUND.
        """
        live = self._live.get(job_id)
        if live is not None and not self._stopping:
            return follow_live(live, after, self._closing, self._settings.keep_alive)
        record, _ = await self.get(job_id)
        if record.event <= after and record.status in ENDED:
            return None
        if record.status not in ENDED and (self._stopping or not self._is_shared):
            return None
        return follow_stored(
            lambda: self.get(job_id), after, self._closing, self._settings.keep_alive
        )

    # ------------------------------------------------------------------------------ running

    def _enqueue(self, live: LiveJob) -> None:
        batch = live.record.path == _BATCH_PATH
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
            replayed = await self._answer(live)
            if self._stopping and replayed.status == status_of(ShuttingDown()):
                return
            status: Status = "succeeded" if replayed.status < 400 else "failed"
            await self._finish(live, status, replayed.answer, replayed.headers.get("location"))
        except ProblemError as problem:
            await self._finish(live, "failed", records.problem_answer(problem, live.record.path))
        except Exception:  # noqa: BLE001  (whatever it is, the job must end)
            mishap = unexpected_fault(f"job {live.record.id}")
            await self._finish(live, "failed", records.problem_answer(mishap, live.record.path))
        finally:
            self._running[batch] -= 1
            self._start_next(batch)

    async def _answer(self, live: LiveJob) -> Replayed:
        caller = Caller(live.record.tenant, live.record.api_key)
        context = JobContext(
            live.record.id, live.deadline, lambda: self._start(live), live.advance, caller
        )
        left = live.deadline + _OVERRUN - time.monotonic()
        try:
            async with asyncio.timeout(max(left, 0.0)):
                request = await when_possible(self._store.request, live.record.id)
                while True:
                    replayed = await replay(self._app, request, context)
                    if not replayed.is_storage_fault:
                        return replayed
                    await asyncio.sleep(storage_retry.STORAGE_RETRY)
        except TimeoutError:
            raise records.overdue_job(self._settings.job_deadline) from None

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
                record, answer = await when_possible(self._store.get, record.id)
            live.settle(record, answer)
        self._live.pop(live.record.id, None)
        await purge(self._store, self._settings)

    # ------------------------------------------------------------------------ other servers

    async def _adopt(self) -> None:
        """Queue jobs whose server is dead; one that has now lost its last attempt has failed."""
        room = max(self._settings.job_limit - len(self._live), 0) if self._is_shared else _ALL
        for record in await run_in_threadpool(self._store.adopt, room):
            if record.id in self._live:
                continue
            ran = record.status == "running"
            live = LiveJob(records.next_attempt(record) if ran else record, self._deadline(), 0)
            live.stored = True
            self._live[record.id] = live
            if live.record.attempt > records.MAX_ATTEMPTS:
                await self._finish(
                    live, "failed", records.problem_answer(records.lost_job(), record.path)
                )
                continue
            if ran:
                await self._save(live)
            self._enqueue(live)

    async def _share_periodically(self) -> None:
        beaten = time.monotonic()
        while True:
            await asyncio.sleep(_SHARING_PERIOD)
            with contextlib.suppress(StorageUnavailable):
                if time.monotonic() - beaten >= HEARTBEAT:
                    beaten = time.monotonic()
                    if not await run_in_threadpool(self._servers.beat, self._server):
                        await run_in_threadpool(self._servers.register, self._server)
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
