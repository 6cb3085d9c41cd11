"""Jobs that agents work on: accepted here, and worked on here too if this process is an agent."""

import asyncio
import contextlib
import dataclasses
import time
from collections.abc import Sequence

from starlette.concurrency import run_in_threadpool
from starlette.types import ASGIApp

from service.access.caller import ANYONE, Caller
from service.http.answers import BUILD_TIMEOUT
from service.jobs.engine import Engine, TryLater, engine_schema
from service.jobs.execution import BATCH_PATH, when_possible
from service.jobs.live_job import LiveJob, new_record
from service.jobs.runner import Jobs
from service.settings import Settings
from service.storage import messages
from service.storage.database import StorageUnavailable
from service.storage.store import Store
from service.storage.stores.idempotency_store import KeptAnswer
from service.storage.stores.job_store import JobRecord, StoredRequest
from service.storage.stores.queue_store import AGENTS, Chunk, Load, batch_of
from service.task_references import cut, plan
from service.workers.chunk_sizes import Pace
from service.workers.process import Background
from service.workers.supervisor import WorkerSupervisor

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

    async def accept(
        self,
        request: StoredRequest,
        told: KeptAnswer[JobRecord] | None = None,
        caller: Caller = ANYONE,
    ) -> JobRecord:
        """Make a job of a request that was checked, for whichever agent takes it.

        Args:
            request: The request.
            told: Answer that the idempotency key of the request stands for from then on.
            caller: Caller who owns the job.

        Raises:
            ProblemError: As `check_room`; STORAGE_UNAVAILABLE.
        """
        await self.check_room(len(request.body), caller)
        new = new_record(request, caller)
        record = dataclasses.replace(new, carrier=AGENTS, event=1)
        await run_in_threadpool(self._store.add, record, request, told)
        return record

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
