"""The server's side of one worker process: its job, its memory, and when it is replaced."""

import asyncio
import contextlib
import logging
import os
import pickle
import resource
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Protocol, cast

from planning.values.deadline import Deadline
from service.workers import main
from service.workers.fork.client import WorkerProcess
from service.workers.main import HEADER
from service.workers.task import Job

_PAGE = os.sysconf("SC_PAGE_SIZE")


class Memory(NamedTuple):
    """Memory of a process.

    Attributes:
        size: its address space [byte]; 0 if it has ended.
        resident: what it has in use [byte]; 0 if it has ended.
    """

    size: int
    resident: int

    @classmethod
    def of(cls, pid: int) -> "Memory":
        """The memory of a process as it is now."""
        try:
            pages = Path(f"/proc/{pid}/statm").read_bytes().split()
        except OSError:
            pages = []
        return cls(int(pages[0]) * _PAGE, int(pages[1]) * _PAGE) if pages else cls(0, 0)


class Watch(Protocol):
    """A follower of one job. It is called on the event loop, and must be quick."""

    def waits(self) -> None:
        """The job waits for a worker again: the one that had it died or was taken away."""

    def begins(self) -> None:
        """A worker has received the job."""

    def reaches(self, stage: str) -> None:
        """The task has reported progress in a stage."""

    def ends(self, outcome: str) -> None:
        """The job has ended.

        Args:
            outcome: "finished", "cancelled", or the code of the problem.
        """


#: Makes the watch of a job that begins to wait, of the name of its task; None if nobody looks.
Watcher = Callable[[str], Watch | None]


_log = logging.getLogger(__name__)

#: Receives the progress of a job, from 0 to 1, and its stage.
OnProgress = Callable[[float, str], None]

#: Longest wait for the exit code of a process that is dying [s].
EXIT_TIMEOUT = 1.0


@dataclass(frozen=True, slots=True)
class Background:
    """Options of a job for which nobody waits.

    Args:
        allowance: Time it may take once a worker has begun with it [s].
        on_start: Called on the event loop when that happens.
        silence: Time from then on in which no progress need be reported [s].
    """

    allowance: float
    on_start: Callable[[], None]
    silence: float = 0.0


@dataclass(slots=True, eq=False)
class Ticket:
    """An accepted job: its place in the queue, then in a worker, until it is settled.

    Args:
        job: The call.
        deadline: Deadline of the result; that of a background job is set when a worker begins.
        payload: The job, pickled.
        result: Result of the caller.
        on_progress: Called with the progress that the task reports.
        background: Given where nobody waits.
        brief: Whether the job takes a millisecond or so, for which a spare worker is good enough.
        yields: How often it gave its worker away.
        timer: Fires when the ticket has overrun.
        worker: Worker that runs the job.
        attempts: How often it was sent to a worker.
        arrived: Whether the worker has received it; of one that lives it is known only of jobs
            whose beginning is reported.
        client: Whom it is for: clients take turns.
        has_share: Whether the job runs as part of the share of background jobs, and gives way to
            nobody.
        causes: How the workers died that it was given to.
        watch: Follows it, where somebody looks.
        begun: Time at which the job was accepted or a worker received it, on `time.monotonic` [s].
        offer: The best result so far that the worker has told; None before the first.
    """

    job: Job[Any]
    deadline: Deadline
    payload: bytes
    result: asyncio.Future[Any]
    on_progress: OnProgress | None
    background: "Background | None" = None
    brief: bool = False
    yields: int = 0
    timer: asyncio.TimerHandle | None = None
    worker: "Worker | None" = None
    attempts: int = 0
    arrived: bool = False
    client: str = ""
    has_share: bool = False
    causes: list[str] = field(default_factory=list)
    watch: Watch | None = None
    begun: float = field(default_factory=time.monotonic)
    offer: Any = None

    @property
    def ends_at(self) -> float:
        """Instant at which the ticket has overrun, on the clock of `time.monotonic` [s]."""
        return self.deadline.at + self.job.grace

    @property
    def outcome(self) -> str:
        """The end that it has come to: "finished", "cancelled", or the code of the problem."""
        if not self.result.done() or self.result.cancelled():
            return "cancelled"
        fault = self.result.exception()
        return "finished" if fault is None else str(getattr(fault, "code", "CRASH"))

    def note_progress(self, share: float, stage: str) -> None:
        """Pass on what the task has reported."""
        if self.result.done():
            return
        if self.watch is not None:
            self.watch.reaches(stage)
        if self.on_progress is not None:
            self.on_progress(share, stage)

    def settle(self, outcome: Any) -> None:
        """Give the caller a result, or an exception, unless there was one already."""
        if self.result.done():
            return
        if isinstance(outcome, BaseException):
            self.result.set_exception(outcome)
        else:
            self.result.set_result(outcome)


class Worker(asyncio.Protocol):
    """The server's side of one worker process."""

    def __init__(
        self, process: WorkerProcess, on_message: Callable[["Worker", tuple[Any, ...]], None]
    ) -> None:
        self.process = process
        self.ticket: Ticket | None = None
        self.warm = False
        self.ending = False
        self.jobs = 0
        self.may_be_worn = False
        self.born = time.monotonic()
        self.resident_at_first = 0
        self.lost_at = 0.0
        self.gone = asyncio.Event()
        self._on_message = on_message
        self._decoder = main.FrameDecoder()
        self._transport: asyncio.WriteTransport | None = None
        self._has_sent_all = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the stream, to send on."""
        self._transport = cast(asyncio.WriteTransport, transport)

    def data_received(self, data: bytes) -> None:
        """Pass on the messages that are complete."""
        try:
            for payload in self._decoder.feed(data):
                self._on_message(self, pickle.loads(payload))
        except Exception:  # noqa: BLE001  (whatever it is, only this worker pays for it)
            _log.exception("worker %s sent what can't be read", self.process.pid)
            self.kill()

    def eof_received(self) -> None:
        """Note whether the system had been given all that was sent."""
        if self._transport is not None:
            self._has_sent_all = self._transport.get_write_buffer_size() == 0

    def connection_lost(self, exc: Exception | None) -> None:
        """Note that the process is dead or about to be, and whether it had received its job.

        Where one end of a stream is closed before all is read that was sent to it, the system tells
        the other end so by an error (unix(7): ECONNRESET), or else that the stream has ended. A
        message about each job that has arrived would cost more than the server's part of it.
        """
        self.ending = True
        if exc is None and self._has_sent_all and self.ticket is not None:
            self.ticket.arrived = True
        self.lost_at = time.monotonic()
        self.gone.set()

    def send(self, ticket: Ticket) -> None:
        """Send a job."""
        assert self._transport is not None
        background, watched = ticket.background, ticket.watch is not None
        tells_start = background is not None or watched
        wants_progress = ticket.on_progress is not None or watched
        silence = 0.0 if background is None or watched else background.silence
        header = HEADER.pack(ticket.deadline.at, tells_start, wants_progress, silence)
        head = main.prefix(len(header) + len(ticket.payload)) + header
        # The payload may be tens of megabytes: it is not copied behind its header.
        self._transport.writelines([head, ticket.payload])

    def kill(self) -> None:
        """End the process, whatever it is doing."""
        self.ending = True
        self.process.kill()
        if self._transport is not None:
            self._transport.abort()


_MEBIBYTE = 2**20


class WorkerLimits(NamedTuple):
    """Limits of one worker.

    Attributes:
        memory: what a worker may ask the system for beyond what it was forked with [byte].
        growth: what a worker may keep after a job beyond that [byte]: caches and what is lost.
        jobs: jobs after which another worker takes its place.
        age: time after which another worker takes its place [s].
    """

    memory: int = 2048 * _MEBIBYTE
    growth: int = 512 * _MEBIBYTE
    jobs: int = 10_000
    age: float = 6 * 3600.0


DEFAULT_LIMITS = WorkerLimits()


def limit_memory(pid: int, limits: WorkerLimits) -> None:
    """Have the system refuse a worker more memory than it may have.

    Args:
        pid: The worker, which was just forked.
        limits: Limits of a worker.
    """
    limit = Memory.of(pid).size + limits.memory
    # A worker that has died already, or of another user, has no limit set.
    with contextlib.suppress(OSError):
        resource.prlimit(pid, resource.RLIMIT_AS, (limit, limit))


def is_worn(worker: Worker, limits: WorkerLimits) -> bool:
    """Whether another worker is to take the place of one that has just done a job."""
    if worker.jobs >= limits.jobs or time.monotonic() - worker.born >= limits.age:
        return True
    return Memory.of(worker.process.pid).resident - worker.resident_at_first > limits.growth
