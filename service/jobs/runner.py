"""Jobs: requests that are stored, answered when their turn comes, and asked for later.

A job is a stored request and, in the end, its answer. What computes it is the application itself,
which is given the request once more: a job can do whatever a request can, and nothing else.
"""

import asyncio
import json
import re
import secrets
import time
from collections import deque
from collections.abc import AsyncIterator
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.types import ASGIApp

from service.http.errors import PROBLEM_MEDIA_TYPE, document, status_of
from service.http.job_context import JobContext
from service.jobs.live_job import Event, LiveJob, describe
from service.jobs.replay import Replayed, replay
from service.problem import ProblemError, unexpected_fault
from service.settings import Settings
from service.storage.job_store import (
    ENDED,
    JobAnswer,
    JobRecord,
    JobStore,
    Status,
    StoredRequest,
    no_job,
)
from service.workers.faults import JobsFull, ShuttingDown

_ID = re.compile(r"[0-9a-f]{32}")
#: Batches that run at the same time; each keeps the workers busy by itself.
_BATCHES = 2
#: How much later than its deadline a job is ended that does not end itself [s].
_OVERRUN = 0.5
#: How often old answers are looked for [s].
_PURGE_PERIOD = 60.0
_BATCH_PATH = "/v1/plan/batch"


class Jobs:
    """All jobs of the service.

    Args:
        app: What answers the requests.
        store: Where jobs are kept.
        settings: Limits and lifetimes.
    """

    def __init__(self, app: ASGIApp, store: JobStore, settings: Settings) -> None:
        self._app = app
        self._store = store
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
        """Queue the jobs that waited when the service ended; those that ran have failed."""
        for record in await run_in_threadpool(self._store.with_status, "running"):
            lost = LiveJob(record, 0.0, 0)
            lost.end("failed", _problem_answer(_lost_job(), record.path))
            await run_in_threadpool(self._store.update, lost.record, lost.answer)
        for record in await run_in_threadpool(self._store.with_status, "queued"):
            live = LiveJob(record, self._deadline(), 0)
            self._live[live.record.id] = live
            self._enqueue(live)
        self._chore(self._purge_periodically())

    async def stop(self) -> None:
        """Accept no more jobs; those that run will be queued when the service starts again."""
        self._stopping = True
        self._closing.set()
        tasks = [live.task for live in self._live.values() if live.task is not None]
        for task in [*tasks, *self._chores]:
            task.cancel()
        await asyncio.gather(*tasks, *self._chores, return_exceptions=True)
        for live in list(self._live.values()):
            if not live.has_ended:
                await run_in_threadpool(self._store.update, live.wait_again())
        self._live.clear()

    @property
    def unfinished_count(self) -> int:
        """Jobs that wait or run."""
        return len(self._live)

    # ------------------------------------------------------------------------- life of one

    def check_room(self, size: int) -> None:
        """See whether a request of a size [byte] would be accepted.

        Raises:
            JobsFull: As many jobs as are allowed wait or run.
            ShuttingDown: The service is about to end.
        """
        if self._stopping:
            raise ShuttingDown
        waiting = sum(live.size for live in self._live.values())
        if len(self._live) >= self._settings.job_limit or (
            waiting + size > self._settings.job_storage and self._live
        ):
            raise JobsFull(len(self._live), self._settings.workers)

    async def accept(self, request: StoredRequest) -> JobRecord:
        """Make a job of a request that was checked.

        Raises:
            ProblemError: As `check_room`.
        """
        self.check_room(len(request.body))
        live = LiveJob(_new_record(request), self._deadline(), len(request.body))
        self._live[live.record.id] = live
        try:
            await run_in_threadpool(self._store.add, live.record, request)
        except BaseException:
            del self._live[live.record.id]
            raise
        accepted = live.record
        self._enqueue(live)
        return accepted

    async def keep(
        self, request: StoredRequest, answer: JobAnswer, location: str | None
    ) -> JobRecord:
        """Make a job of a request that was answered already."""
        if self._stopping:
            raise ShuttingDown
        live = LiveJob(_new_record(request), self._deadline(), 0)
        await run_in_threadpool(self._store.add, live.record, None)
        live.start()
        live.end("succeeded", answer, location)
        await run_in_threadpool(self._store.update, live.record, answer)
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

    async def list(self, status: Status | None, before: str, limit: int) -> list[JobRecord]:
        """Jobs before one of an id, newest first, as they stand now."""
        stored = await run_in_threadpool(self._store.list, status, before, limit)
        return [self._live[r.id].record if r.id in self._live else r for r in stored]

    async def cancel(self, job_id: str) -> JobRecord:
        """End a job; one that was cancelled before stays so.

        Raises:
            ProblemError: NOT_FOUND; CONFLICT, it has ended already.
        """
        live = self._live.get(job_id)
        if live is None or live.has_ended:
            record, _ = await self.get(job_id)
            if record.status == "cancelled":
                return record
            raise ProblemError(
                "CONFLICT",
                f"job {job_id} has ended already: it {_final_status(record.status)}",
                stage="job",
                hint="There is nothing to cancel; GET it for its answer.",
                status_of_job=record.status,
            )
        await self._finish(live, "cancelled", None)
        return live.record

    async def events(self, job_id: str, after: int) -> AsyncIterator[bytes] | None:
        """The events of a job after one of a number, as they come; None if there are no more.

        Raises:
            ProblemError: NOT_FOUND.
        """
        live = self._live.get(job_id)
        if live is not None and not self._stopping:
            return self._stream(live, after)
        record, answer = await self.get(job_id)
        if record.status not in ENDED or record.event <= after:
            return None
        error = answer.content if record.status == "failed" and answer is not None else None
        return _single_event(describe(record, "end", error))

    # ------------------------------------------------------------------------------ running

    def _enqueue(self, live: LiveJob) -> None:
        batch = live.record.path == _BATCH_PATH
        self._queues[batch].append(live)
        self._start_next(batch)

    def _start_next(self, batch: bool) -> None:
        queue = self._queues[batch]
        while queue and self._running[batch] < self._limits[batch] and not self._stopping:
            live = queue.popleft()
            if live.has_ended:
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
            await self._finish(live, "failed", _problem_answer(problem, live.record.path))
        except Exception:  # noqa: BLE001  (whatever it is, the job must end)
            mishap = unexpected_fault(f"job {live.record.id}")
            await self._finish(live, "failed", _problem_answer(mishap, live.record.path))
        finally:
            self._running[batch] -= 1
            self._start_next(batch)

    async def _answer(self, live: LiveJob) -> Replayed:
        request = await run_in_threadpool(self._store.request, live.record.id)
        context = JobContext(live.record.id, live.deadline, lambda: self._start(live), live.advance)
        left = live.deadline + _OVERRUN - time.monotonic()
        try:
            async with asyncio.timeout(max(left, 0.0)):
                return await replay(self._app, request, context)
        except TimeoutError:
            raise ProblemError(
                "TIMED_OUT",
                f"the job did not end within {self._settings.job_deadline:g} s",
                stage="job",
                hint="Ask for less at once, or raise ARMWRIGHT_JOB_DEADLINE where the service is "
                "run.",
            ) from None

    def _start(self, live: LiveJob) -> None:
        if live.start():
            self._chore(self._save(live))

    async def _save(self, live: LiveJob) -> None:
        async with live.saving:
            if not live.has_ended:
                await run_in_threadpool(self._store.update, live.record)

    async def _finish(
        self, live: LiveJob, status: Status, answer: JobAnswer | None, location: str | None = None
    ) -> None:
        if live.has_ended:
            return
        live.end(status, answer, location)
        if status == "cancelled" and live.task is not None:
            live.task.cancel()
        async with live.saving:
            await run_in_threadpool(self._store.update, live.record, answer)
        self._live.pop(live.record.id, None)
        await self._purge()

    # ------------------------------------------------------------------------------- chores

    def _deadline(self) -> float:
        return time.monotonic() + self._settings.job_deadline

    def _chore(self, work: Any) -> None:
        task: asyncio.Task[None] = asyncio.create_task(work)
        self._chores.add(task)
        task.add_done_callback(self._chores.discard)

    async def _purge(self) -> None:
        oldest = time.time() - self._settings.job_lifetime
        await run_in_threadpool(
            self._store.purge, oldest, self._settings.job_count, self._settings.job_storage
        )

    async def _purge_periodically(self) -> None:
        while True:
            await self._purge()
            await asyncio.sleep(_PURGE_PERIOD)

    async def _stream(self, live: LiveJob, after: int) -> AsyncIterator[bytes]:
        while True:
            changed = live.changed
            for event in live.since(after):
                after = event.number
                yield event.encode()
            if live.has_ended or self._stopping:
                return
            if not await self._change(changed):
                yield b": keep-alive\n\n"

    async def _change(self, changed: asyncio.Event) -> bool:
        """Wait for a change, but not for ever; whether there was one."""
        waiting = [asyncio.ensure_future(event.wait()) for event in (changed, self._closing)]
        try:
            done, _ = await asyncio.wait(
                waiting,
                timeout=self._settings.keep_alive,
                return_when=asyncio.FIRST_COMPLETED,
            )
            return bool(done)
        finally:
            for future in waiting:
                future.cancel()


async def _single_event(event: Event) -> AsyncIterator[bytes]:
    yield event.encode()


def _new_record(request: StoredRequest) -> JobRecord:
    # Twelve digits of time let later jobs sort after earlier ones; the rest can't be guessed.
    now = time.time()
    job_id = f"{int(1000 * now):012x}{secrets.token_hex(10)}"
    return JobRecord(job_id, request.method, request.path, "queued", created=now)


def _problem_answer(problem: ProblemError, instance: str) -> JobAnswer:
    content = json.dumps(document(problem, instance), ensure_ascii=False, allow_nan=False)
    return JobAnswer(PROBLEM_MEDIA_TYPE, content.encode())


def _lost_job() -> ProblemError:
    return ProblemError(
        "CRASH",
        "the service ended while it was working on this job",
        stage="job",
        hint="Send the request again: nothing of it was kept.",
    )


def _final_status(status: Status) -> str:
    return status if status in ("succeeded", "failed") else "is being ended"
