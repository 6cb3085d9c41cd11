"""A job that has not ended yet: where it stands, and the stream of its events."""

import asyncio
import json
import secrets
import time
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from pydantic_core import to_json

from service.access.caller import Caller
from service.http.errors import PROBLEM_MEDIA_TYPE, document
from service.problem import ProblemError
from service.storage.stores.job_store import ENDED, JobAnswer, JobRecord, Status, StoredRequest

#: Servers that may die while they work on a job: after that, it may be what kills them.
MAX_ATTEMPTS = 2


def new_record(request: StoredRequest, caller: Caller) -> JobRecord:
    """The record of a new job of a caller, which waits."""
    # Twelve digits of time let later jobs sort after earlier ones; the rest can't be guessed.
    now = time.time()
    job_id = f"{int(1000 * now):012x}{secrets.token_hex(10)}"
    return JobRecord(
        job_id,
        request.method,
        request.path,
        "queued",
        created=now,
        tenant=caller.tenant,
        api_key=caller.api_key,
    )


def problem_answer(problem: ProblemError, instance: str) -> JobAnswer:
    """The answer of a job that failed: the problem of a request to the path `instance`."""
    content = json.dumps(document(problem, instance), ensure_ascii=False, allow_nan=False)
    return JobAnswer(PROBLEM_MEDIA_TYPE, content.encode())


def waiting_again(record: JobRecord) -> JobRecord:
    """The record of a job that begins anew."""
    return replace(record, status="queued", progress=0.0, stage=None, started=None)


def next_attempt(record: JobRecord) -> JobRecord:
    """The record of a job that waits again, since the server died that worked on it."""
    return replace(waiting_again(record), attempt=record.attempt + 1)


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
    data: dict[str, Any] = {
        "id": record.id,
        "status": record.status,
        "progress": record.progress,
        "stage": record.stage,
    }
    text = to_json(data)
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

    def wait_again(self) -> JobRecord:
        """The record of this job for the next start of the service: it waits again."""
        return waiting_again(self.record)

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
