"""The work on jobs: those that this process has, run by the application, and their ends stored.

What computes a job is the application itself, which is given the request once more: a job can do
whatever a request can, and nothing else.

A job that has not ended yet: where it stands, and the stream of its events.
"""

import asyncio
import contextlib
import logging
import time
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterator
from dataclasses import dataclass, replace
from typing import Any, ParamSpec, TypeVar

from pydantic_core import to_json
from starlette.concurrency import run_in_threadpool
from starlette.types import ASGIApp

from service.access.authentication import Caller
from service.fields import picked
from service.http.errors import PROBLEM_MEDIA_TYPE, problem_content, status_of
from service.http.state import JobContext, new_id
from service.jobs.replay import Replayed, replay
from service.settings import Settings
from service.storage.database import StorageUnavailable
from service.storage.store import Store
from service.storage.stores.job_store import (
    ENDED,
    JobAnswer,
    JobRecord,
    JobStore,
    Status,
    StoredRequest,
)
from service.storage.stores.server_store import HEARTBEAT
from service.validation import ProblemError, unexpected_fault
from service.workers.state import ShuttingDown

#: Servers that may die while they work on a job: after that, it may be what kills them.
MAX_ATTEMPTS = 2


def new_record(request: StoredRequest, caller: Caller) -> JobRecord:
    """The record of a new job of a caller, which waits."""
    return JobRecord(
        new_id(),
        request.method,
        request.path,
        "queued",
        created=time.time(),
        tenant=caller.tenant,
        api_key=caller.api_key,
    )


def problem_answer(problem: ProblemError, instance: str) -> JobAnswer:
    """The answer of a job that failed: the problem of a request to the path `instance`."""
    return JobAnswer(PROBLEM_MEDIA_TYPE, problem_content(problem, instance))


def waiting_again(record: JobRecord) -> JobRecord:
    """The record of a job that begins anew."""
    return replace(record, status="queued", progress=0.0, stage=None, started=None)


def lost_job() -> ProblemError:
    """The problem of a job that ran each time that a server died."""
    return ProblemError(
        "CRASH",
        f"the service died {MAX_ATTEMPTS} times while it was working on this job",
        stage="job",
        hint="Send the request again: nothing of it was kept.",
    )


def overdue_job(seconds: float) -> ProblemError:
    """The problem of a job that did not end within the time that a job may take [s]."""
    return ProblemError(
        "TIMED_OUT",
        f"the job did not end within {seconds:g} s",
        stage="job",
        hint="Ask for less at once, or raise ARMWRIGHT_JOB_DEADLINE where the service is run.",
    )


#: Events kept for clients that come late or come back; each event holds the state as a whole.
_KEPT_EVENTS = 256


@dataclass(frozen=True, slots=True)
class Event:
    """A server-sent event of a job.

    Args:
        number: Counted from 1 for each job, across restarts of the service.
        kind: status, stage, progress or end.
        data: JSON.
    """

    number: int
    kind: str
    data: bytes

    def encode(self) -> bytes:
        """The event as the HTML standard has it on the wire."""
        return b"id: %d\nevent: %s\ndata: %s\n\n" % (self.number, self.kind.encode(), self.data)


def describe(record: JobRecord, kind: str, error: bytes | None = None) -> Event:
    """The event that tells where a job stands now."""
    text = to_json(picked(record, "id", "status", "progress", "stage"))
    if error is not None:
        text = text[:-1] + b',"error":' + error + b"}"
    return Event(record.event, kind, text)


class LiveJob:
    """A job that waits or runs.

    Args:
        record: Record of the job: its status and progress.
        deadline: Deadline of the job, on the clock of `time.monotonic` [s].
        size: Size of the request [byte].
    """

    def __init__(self, record: JobRecord, deadline: float, size: int) -> None:
        self.record = record
        self.deadline = deadline
        self.size = size
        self.answer: JobAnswer | None = None
        self.task: asyncio.Task[None] | None = None
        self.saving = asyncio.Lock()
        #: Whether the database has it.
        self.stored = False
        #: What the database has of its progress, as the number of an event.
        self.saved_event = 0
        #: Whether no change comes any more: its end is being stored.
        self.is_ending = False
        #: Whether another server has taken it over.
        self.is_gone = False
        self.changed = asyncio.Event()
        self._events: deque[Event] = deque(maxlen=_KEPT_EVENTS)
        self._publish("status")

    @property
    def has_ended(self) -> bool:
        """Whether it has succeeded, failed or was cancelled."""
        return self.record.status in ENDED

    def start(self) -> bool:
        """Note that a worker has begun with it; whether that is news."""
        if self.record.status != "queued":
            return False
        self.record = replace(self.record, status="running", started=time.time())
        self._publish("status")
        return True

    def advance(self, progress: float, stage: str) -> None:
        """Note the progress, which never goes back, also where the work began anew."""
        if self.has_ended or self.is_ending:
            return
        further = min(max(self.record.progress, progress), 1.0)
        kind = "stage" if stage != self.record.stage else "progress"
        if kind == "progress" and further == self.record.progress:
            return
        self.record = replace(self.record, progress=further, stage=stage)
        self._publish(kind)

    def end(self, status: Status, answer: JobAnswer | None, location: str | None = None) -> None:
        """Note that it has ended."""
        self.settle(self.last_record(status, location), answer)

    def last_record(self, status: Status, location: str | None = None) -> JobRecord:
        """The record of its end, to be stored before anybody is told; nothing changes any more."""
        self.is_ending = True
        return replace(
            self.record,
            status=status,
            progress=1.0 if status == "succeeded" else self.record.progress,
            event=self.record.event + 1,
            ended=time.time(),
            location=location,
        )

    def settle(self, record: JobRecord, answer: JobAnswer | None) -> None:
        """Note the end that was stored, and tell of it; or that another server has it now."""
        self.record, self.answer = record, answer
        if not self.has_ended:
            self.is_gone = True
            self.changed.set()
            return
        self._tell("end", answer.content if record.status == "failed" and answer else None)

    def since(self, number: int) -> Iterator[Event]:
        """The events after one of a number."""
        return iter([event for event in self._events if event.number > number])

    def _publish(self, kind: str) -> None:
        self.record = replace(self.record, event=self.record.event + 1)
        self._tell(kind)

    def _tell(self, kind: str, error: bytes | None = None) -> None:
        self._events.append(describe(self.record, kind, error))
        self.changed.set()
        self.changed = asyncio.Event()


#: How often the database is asked where a job of another server stands [s].
_POLL_PERIOD = 0.5
_SIGN_OF_LIFE = b": keep-alive\n\n"


async def follow_live(
    live: LiveJob, after: int, closing: asyncio.Event, keep_alive: float
) -> AsyncIterator[bytes]:
    """The events of a job of this server, as they come.

    Args:
        live: The job.
        after: The number of the last event that was received.
        closing: Set when the service ends.
        keep_alive: Longest silence [s].
    """
    while True:
        changed = live.changed
        for event in live.since(after):
            after = event.number
            yield event.encode()
        if live.has_ended or live.is_gone or closing.is_set():
            return
        if not await _is_set(keep_alive, changed, closing):
            yield _SIGN_OF_LIFE


async def follow_stored(
    get: Callable[[], Awaitable[tuple[JobRecord, JobAnswer | None]]],
    after: int,
    closing: asyncio.Event,
    keep_alive: float,
) -> AsyncIterator[bytes]:
    """The events of a job that is in the database only, as they are seen there.

    Args:
        get: Reads the job.
        after: The number of the last event that was received.
        closing: Set when the service ends.
        keep_alive: Longest silence [s].
    """
    clock = asyncio.get_running_loop().time
    told = clock()
    while True:
        record, answer = await get()
        ended = record.status in ENDED
        if record.event > after:
            after, told = record.event, clock()
            failed = record.status == "failed" and answer is not None
            error = answer.content if failed and answer is not None else None
            yield describe(record, "end" if ended else "status", error).encode()
        if ended or closing.is_set():
            return
        if clock() - told >= keep_alive:
            told = clock()
            yield _SIGN_OF_LIFE
        await _is_set(min(_POLL_PERIOD, keep_alive), closing)


async def _is_set(timeout: float, *events: asyncio.Event) -> bool:
    """Wait for the first of some events, but not for ever; whether there was one."""
    waiting = [asyncio.ensure_future(event.wait()) for event in events]
    try:
        done, _ = await asyncio.wait(waiting, timeout=timeout, return_when=asyncio.FIRST_COMPLETED)
        return bool(done)
    finally:
        for future in waiting:
            future.cancel()


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
                    await run_in_threadpool(self._store.release, waiting_again(live.record))
            await run_in_threadpool(self._servers.remove, self._server)
        except StorageUnavailable as problem:
            _log.warning("jobs could not be given back: %s", problem.detail)
        for live in self._live.values():
            if not live.has_ended:
                live.settle(waiting_again(live.record), None)
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
        waits = replace(waiting_again(record), attempt=record.attempt + 1) if ran else record
        live = LiveJob(waits, deadline, 0)
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
