"""Jobs that agents work on: accepted here, and worked on here too if this process is an agent.

Jobs: requests that are stored, answered when their turn comes, and asked for later.
"""

import asyncio
import contextlib
import dataclasses
import re
import time
from collections.abc import AsyncIterator, Sequence

from starlette.concurrency import run_in_threadpool
from starlette.types import ASGIApp

from service.access.authentication import ANYONE, Caller
from service.http.answers import BUILD_TIMEOUT
from service.jobs.batch import joined_answer
from service.jobs.engine import Engine, TryLater, engine_schema
from service.jobs.execution import (
    BATCH_PATH,
    JobExecution,
    LiveJob,
    follow_live,
    follow_stored,
    new_record,
    purge_periodically,
    when_possible,
)
from service.settings import Settings
from service.storage import messages
from service.storage.database import StorageUnavailable
from service.storage.store import Store
from service.storage.stores.idempotency_store import KeptAnswer
from service.storage.stores.job_store import (
    AGENTS,
    ENDED,
    Chunk,
    JobAnswer,
    JobRecord,
    Load,
    Status,
    StoredRequest,
    batch_of,
    no_job,
)
from service.task_references import cut, plan
from service.validation import ProblemError
from service.workers.chunk_sizes import Pace
from service.workers.process import Background
from service.workers.state import JobsFull, ShuttingDown
from service.workers.supervisor import WorkerSupervisor

_ID = re.compile(r"[0-9a-f]{32}")
#: Longest time that who cancels a job waits for the storage [s].
_CANCEL_TIMEOUT = 5.0


class Jobs(JobExecution):
    """All jobs of the service.

    Args:
        app: Application that answers the requests.
        store: Store of the jobs.
        settings: Limits and lifetimes.
    """

    def __init__(self, app: ASGIApp, store: Store, settings: Settings) -> None:
        super().__init__(app, store, settings)
        self._queue = store.queue
        self._closing = asyncio.Event()

    # ------------------------------------------------------------------------- life of all

    async def start(self) -> None:
        """Queue the jobs that waited or ran when their server ended."""
        await run_in_threadpool(self._servers.register, self._server, self._capacity)
        await self._adopt()
        self._chore(purge_periodically(self._store, self._settings))
        if self._is_shared:
            self._chore(self._share_periodically())

    async def stop(self) -> None:
        """Accept no more jobs; those that run will be queued when the service starts again."""
        self._stopping = True
        self._closing.set()
        await self._end_work()

    @property
    def is_connected(self) -> bool:
        """Whether messages of jobs come, if there are to be any."""
        return True

    async def waiting_messages(self) -> int | None:
        """The number of jobs and chunks that wait for an agent; None where there are no agents."""
        return None

    # ------------------------------------------------------------------------- life of one

    async def check_room(self, size: int, caller: Caller = ANYONE) -> None:
        """See whether a request of a size [byte] of a caller would be accepted.

        Raises:
            JobsFull: As many jobs as are allowed wait or run.
            ShuttingDown: The service is about to end.
        """
        if self._stopping:
            raise ShuttingDown
        load = await self._load(caller)
        if caller.job_limit is not None and load.of_key >= caller.job_limit:
            raise JobsFull(load.of_key, self._settings.workers)
        if load.count >= self._settings.job_limit or (
            load.size + size > self._settings.job_storage and load.count
        ):
            raise JobsFull(load.count, self._settings.workers)

    async def _load(self, caller: Caller) -> Load:
        """Jobs that wait or run, and those of a caller among them."""
        own = sum(live.record.api_key == caller.api_key for live in self._live.values())
        return Load(len(self._live), own, sum(live.size for live in self._live.values()))

    async def accept(
        self,
        request: StoredRequest,
        told: KeptAnswer[JobRecord] | None = None,
        caller: Caller = ANYONE,
    ) -> JobRecord:
        """Make a job of a request that was checked.

        Args:
            request: The request.
            told: Answer that the idempotency key of the request stands for from then on.
            caller: Caller who owns the job.

        Raises:
            ProblemError: As `check_room`; STORAGE_UNAVAILABLE.
        """
        await self.check_room(len(request.body), caller)
        return await self._begin(new_record(request, caller), request, told)

    async def _begin(
        self, record: JobRecord, request: StoredRequest, told: KeptAnswer[JobRecord] | None
    ) -> JobRecord:
        """Store a new job and queue it; its record as it was accepted."""
        live = LiveJob(record, self._deadline(), len(request.body))
        self._live[record.id] = live
        try:
            await run_in_threadpool(self._store.add, live.record, request, told)
        except BaseException:
            del self._live[record.id]
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
            answer: Answer of the job.
            location: Path of the resource that the job created.
            told: Answer that the idempotency key of the request stands for from then on.
            caller: Caller who owns the job.

        Raises:
            ProblemError: STORAGE_UNAVAILABLE; the service is about to end.
        """
        if self._stopping:
            raise ShuttingDown
        live = LiveJob(new_record(request, caller), self._deadline(), 0)
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
        return await run_in_threadpool(self._stored, job_id)

    def _stored(self, job_id: str) -> tuple[JobRecord, JobAnswer | None]:
        record, answer = self._store.get(job_id)
        if answer is None and record.is_answered_in_chunks:
            chunks = self._queue.chunk_answers(job_id)
            if sum(chunk.size for chunk in chunks) != record.size:  # it is forgotten just now
                raise no_job(job_id)
            answer = joined_answer(chunks)
        return record, answer

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

        async def stored() -> tuple[JobRecord, JobAnswer | None]:
            # Events tell problems, but no results.
            return await run_in_threadpool(self._store.get, job_id)

        return follow_stored(stored, after, self._closing, self._settings.keep_alive)


#: How long jobs may go on when an agent is told to end; then it gives them back [s].
DRAIN = 5.0
#: Messages that an agent has beyond one for each worker: while one is stored, another one runs.
_AHEAD = 1


class AgentJobs(Jobs):
    """Jobs that a queue carries to agents.

    Args:
        app: Application that answers the requests.
        store: Store of the jobs, in PostgreSQL.
        settings: Limits and lifetimes.
        supervisor: The workers of this process.
        is_agent: Whether this process works on jobs.
    """

    def __init__(
        self,
        app: ASGIApp,
        store: Store,
        settings: Settings,
        supervisor: WorkerSupervisor,
        *,
        is_agent: bool,
    ) -> None:
        super().__init__(app, store, settings)
        self._database = store.database
        self._supervisor = supervisor
        self._engine: Engine | None = None
        self._taking: asyncio.Task[None] | None = None
        if is_agent:
            self._capacity = settings.workers
            concurrency = settings.workers + _AHEAD
            self._limits = {False: concurrency, True: concurrency}
            self._engine = Engine(settings.storage_url, concurrency, self.carry)

    async def start(self) -> None:
        """Take messages of jobs, if this process is an agent."""
        await run_in_threadpool(messages.install, self._database, engine_schema())
        await super().start()
        if self._engine is not None:
            self._taking = asyncio.create_task(self._engine.run())

    async def stop(self) -> None:
        """Accept no more jobs; end those that run if that takes seconds, and give back the rest."""
        if self._engine is not None and self._taking is not None:
            self._engine.stop()
            await asyncio.wait({self._taking}, timeout=DRAIN)
        await super().stop()
        if self._taking is not None:
            # Their jobs were given back, so that the messages are too.
            await asyncio.wait({self._taking}, timeout=DRAIN)
            self._taking.cancel()

    @property
    def is_connected(self) -> bool:
        """Whether messages come, if this process is to take any."""
        return self._engine is None or self._engine.is_connected

    # ---------------------------------------------------------------------------- accepting

    async def _load(self, caller: Caller) -> Load:
        """Jobs that wait or run on all machines together, and those of a caller among them."""
        return await run_in_threadpool(self._queue.load, caller.api_key)

    async def _begin(
        self, record: JobRecord, request: StoredRequest, told: KeptAnswer[JobRecord] | None
    ) -> JobRecord:
        """Store a new job for whichever agent takes it."""
        stored = dataclasses.replace(record, carrier=AGENTS, event=1)
        await run_in_threadpool(self._store.add, stored, request, told)
        return stored

    # ------------------------------------------------------------------------------ working

    async def carry(self, job_id: str) -> None:
        """Work on a job until its end is stored, if no other agent does.

        Raises:
            TryLater: There is work on it left, for this or for another agent.
        """
        live = self._live.get(job_id) or await self._claim(job_id)
        if live is None:
            if await when_possible(self._queue.is_open, job_id):
                raise TryLater
            await self._join(batch_of(job_id))
            return
        while not (live.has_ended or live.is_gone):
            await live.changed.wait()
        if not live.has_ended:
            if self._stopping:
                raise TryLater(0.0)
            if await when_possible(self._queue.is_open, job_id):
                raise TryLater
            return
        await self._join(live.record.parent)

    async def _claim(self, job_id: str) -> LiveJob | None:
        record = await run_in_threadpool(self._queue.claim, job_id)
        if record is None:
            return None
        left = record.created + self._settings.job_deadline - time.time()
        return await self._take(record, time.monotonic() + left)

    async def _work(self, live: LiveJob) -> None:
        if live.record.path == BATCH_PATH and live.record.parent is None:
            chunks = await self._chunks(live)
            if len(chunks) > 1:
                async with live.saving:
                    await when_possible(self._queue.cut, live.record, chunks)
                    live.settle(live.record, None)
                self._live.pop(live.record.id, None)
                return
        await super()._work(live)

    async def _chunks(self, live: LiveJob) -> Sequence[Chunk]:
        """The chunks into which a batch is cut by the durations that plans have had."""
        request = await when_possible(self._store.request, live.record.id)
        everywhere = await when_possible(self._servers.capacity)
        pace = Pace(self._supervisor.durations.mean(plan.name), self._supervisor.count, everywhere)
        return await self._supervisor.submit(
            cut.job(request.body, pace), None, Background(BUILD_TIMEOUT, lambda: self._start(live))
        )

    async def _join(self, batch: str | None) -> None:
        """End a batch if the chunk that has ended was its last one."""
        if batch is not None and not await when_possible(self._queue.join, batch):
            await self._report(batch)

    async def _save(self, live: LiveJob) -> None:
        await super()._save(live)
        if live.record.parent is not None:
            await self._report(live.record.parent)

    async def _report(self, batch: str) -> None:
        with contextlib.suppress(StorageUnavailable):  # the next one tells it too
            await run_in_threadpool(self._queue.report, batch)

    async def _forget_old(self) -> None:
        """Leave old answers to the chore: an agent ends many jobs, and others' answers too."""

    async def waiting_messages(self) -> int | None:
        """The number of jobs and chunks that wait for an agent."""
        return await run_in_threadpool(messages.waiting_messages, self._database)
