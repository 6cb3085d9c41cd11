"""The supervisor of the worker processes.

Every worker is a process of its own with one stream to the server. All bookkeeping happens on the
event loop: a worker is starting, idle or has one ticket; when its stream ends it is dead, whatever
the reason, and another is started in its place. Nothing is shared between workers, so nothing that
happens to one can be noticed by the request of another.
"""

import asyncio
import contextlib
import logging
import math
import multiprocessing
import pickle
import socket
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from service.http.errors import from_fields
from service.http.handlers import unexpected
from service.warm import warm_kernels
from service.workers import main
from service.workers.faults import DeadlineExceeded, QueueFull, ShuttingDown, WorkerCrashed
from service.workers.main import Job, Reply
from service.workers.process import Background, Progress, Ticket, Worker, in_thread, reap, start

_log = logging.getLogger(__name__)

#: Where the functions are that workers may be asked to call.
TASK_MODULES = (
    "service.tasks.robots",
    "service.tasks.large_body",
    "service.tasks.batch",
    "service.tasks.kinematics",
    "service.tasks.inverse_kinematics",
    "service.tasks.check",
    "service.tasks.plan",
    "service.tasks.potential",
    "service.tasks.retime",
    "service.tasks.dynamics",
    "service.tasks.simulate",
)
#: A worker that dies before a job has reached it is not the job's fault; but a job that can't even
#: be received must not go round for ever.
_MAX_ATTEMPTS = 3
_FIRST_PAUSE, _LONGEST_PAUSE = 0.01, 1.0  # between failed starts of a worker [s]
#: A worker may be killed while it starts; only several in a row mean that none can start.
_FAILURES = 3
_MEAN_WEIGHT = 0.1  # of the newest job in the mean duration
#: A request that has waited so long takes the worker of a background job [s]: longer than most
#: requests need, shorter than a person notices.
_YIELD_AFTER = 0.2
#: How often one background job gives way and begins anew; then it runs to its end.
_MAX_YIELDS = 3


@dataclass(slots=True)
class Counters:
    """What the supervisor has seen since it started."""

    finished: int = 0
    crashed: int = 0
    overrun: int = 0
    cancelled: int = 0
    rejected: int = 0
    yielded: int = 0
    started_workers: int = 0


class WorkerSupervisor:
    """Runs jobs in worker processes, and keeps the workers alive.

    Jobs for which somebody waits go first. Background jobs may hold all workers; where somebody
    waits nevertheless, the one that began last gives way and begins anew later.

    Args:
        count: Worker processes.
        queue_limit: Jobs that may wait while all workers are busy.
        grace: How far a job may overrun its deadline before its worker is killed [s].
        modules: The modules whose functions may be called.
        warm: What each worker calls before it counts as ready; picklable.
    """

    def __init__(
        self,
        count: int,
        queue_limit: int,
        *,
        grace: float = 0.1,
        modules: Sequence[str] = TASK_MODULES,
        warm: Callable[[], object] = warm_kernels,
    ) -> None:
        self.counters = Counters()
        self._count = count
        self._queue_limit = queue_limit
        self._grace = grace
        self._modules = tuple(modules)
        self._warm = warm
        self._waiting: deque[Ticket] = deque()
        self._background: deque[Ticket] = deque()
        self._idle: list[Worker] = []
        self._workers: set[Worker] = set()
        self._tenders: list[asyncio.Task[None]] = []
        self._warmed: set[int] = set()
        self._failing: set[int] = set()
        self._accepting = False
        self._mean_seconds = 0.1
        self._context = multiprocessing.get_context("forkserver")
        self._starting = asyncio.Lock()

    @property
    def ready(self) -> bool:
        """Whether every worker has been warm once and none fails to start."""
        return self._accepting and len(self._warmed) == self._count and not self._failing

    @property
    def waiting(self) -> int:
        """Jobs that wait for a worker and for which somebody waits."""
        return len(self._waiting)

    @property
    def background_waiting(self) -> int:
        """Background jobs that wait for a worker."""
        return len(self._background)

    @property
    def count(self) -> int:
        """How many workers there ought to be."""
        return self._count

    @property
    def busy(self) -> int:
        """Workers that have a job."""
        return sum(worker.ticket is not None for worker in self._workers)

    @property
    def pids(self) -> list[int]:
        """The process numbers of the workers that live."""
        return [worker.process.pid for worker in self._workers if worker.process.pid is not None]

    async def start(self) -> None:
        """Start the workers, without waiting until they are ready."""
        self._context.set_forkserver_preload(["__main__", "service.preload"])
        self._accepting = True
        self._tenders = [asyncio.create_task(self._tend(slot)) for slot in range(self._count)]

    async def stop(self) -> None:
        """Refuse all jobs, those that run among them, and end the workers."""
        self.abandon()
        for tender in self._tenders:
            tender.cancel()
        await asyncio.gather(*self._tenders, return_exceptions=True)
        workers = list(self._workers)
        for worker in workers:
            worker.kill()
        await asyncio.gather(*(in_thread(reap, worker.process) for worker in workers))
        self._workers.clear()

    def abandon(self) -> None:
        """Accept no more jobs and tell those that wait or run that the service is ending."""
        self._accepting = False
        running = [worker.ticket for worker in self._workers if worker.ticket is not None]
        for ticket in [*self._waiting, *self._background, *running]:
            ticket.settle(ShuttingDown())

    async def submit(
        self,
        job: Job,
        deadline: float,
        on_progress: Progress | None = None,
        background: Background | None = None,
    ) -> Any:
        """Run a job in a worker.

        When the caller is cancelled, the job is taken from the queue, or its worker is killed.

        Args:
            job: What to call.
            deadline: When the result must be there, on the clock of `time.monotonic` [s].
            on_progress: Called on the event loop with what the job reports of itself.
            background: Given where nobody waits. The queue has no limit for these; whoever
                submits them minds their number.

        Returns:
            What the task function returned.

        Raises:
            QueueFull: Too many jobs are waiting.
            DeadlineExceeded: The deadline passed.
            WorkerCrashed: The worker died.
            ShuttingDown: The supervisor is being stopped, or was not started.
            ProblemError: The task function raised: the caller's fault as the domain told it, or
                CRASH with the reference under which our own was logged.
        """
        if not self._accepting:
            raise ShuttingDown
        if background is None and not self._idle and len(self._waiting) >= self._queue_limit:
            self.counters.rejected += 1
            raise QueueFull(len(self._waiting), self._retry_after())
        loop = asyncio.get_running_loop()
        payload = pickle.dumps(job, pickle.HIGHEST_PROTOCOL)
        ticket = Ticket(job, deadline, payload, loop.create_future(), on_progress, background)
        self._set_timer(ticket, deadline)
        self._queue(ticket).append(ticket)
        self._dispatch()
        patience = None
        if background is None and ticket.worker is None:
            patience = loop.call_later(_YIELD_AFTER, self._make_room, ticket)
        try:
            return await ticket.result
        finally:
            if patience is not None:
                patience.cancel()
            self._withdraw(ticket)

    # ------------------------------------------------------------------------------- tickets

    def _queue(self, ticket: Ticket) -> deque[Ticket]:
        return self._waiting if ticket.background is None else self._background

    def _dispatch(self) -> None:
        while self._idle and (self._waiting or self._background):
            worker = self._idle.pop()
            if worker.doomed:
                continue
            ticket = (self._waiting or self._background).popleft()
            ticket.worker, worker.ticket = worker, ticket
            ticket.attempts += 1
            if ticket.background is not None:
                ticket.deadline = time.monotonic() + ticket.background.allowance
            self._set_timer(ticket, ticket.deadline + self._grace)
            worker.send(ticket)

    def _make_room(self, waiting: Ticket) -> None:
        """Take the worker of the background job that loses least by it, for one that waits."""
        if waiting not in self._waiting:
            return
        yielding = [
            worker
            for worker in self._workers
            if worker.ticket is not None
            and not worker.doomed
            and worker.ticket.background is not None
            and worker.ticket.yields < _MAX_YIELDS
        ]
        if not yielding:
            return
        worker = max(yielding, key=lambda worker: worker.ticket.begun if worker.ticket else 0.0)
        ticket = worker.ticket
        assert ticket is not None
        ticket.yields += 1
        self.counters.yielded += 1
        self._put_back(ticket)
        worker.ticket = None
        worker.kill()

    def _put_back(self, ticket: Ticket) -> None:
        """Have a job wait once more, in front of all others of its kind."""
        ticket.worker, ticket.arrived = None, False
        if ticket.background is not None:
            self._set_timer(ticket, math.inf)
        self._queue(ticket).appendleft(ticket)

    def _set_timer(self, ticket: Ticket, when: float) -> None:
        if ticket.timer is not None:
            ticket.timer.cancel()
            ticket.timer = None
        if math.isfinite(when):
            loop = asyncio.get_running_loop()
            delay = max(when - time.monotonic(), 0.0)
            ticket.timer = loop.call_later(delay, self._expire, ticket)

    def _expire(self, ticket: Ticket) -> None:
        self.counters.overrun += 1
        where = "waiting for a worker" if ticket.worker is None else "being computed"
        ticket.settle(DeadlineExceeded(ticket.job.task, where))
        self._let_go(ticket)

    def _withdraw(self, ticket: Ticket) -> None:
        if ticket.timer is not None:
            ticket.timer.cancel()
        if ticket.result.cancelled():
            self.counters.cancelled += 1
        self._let_go(ticket)

    def _let_go(self, ticket: Ticket) -> None:
        """Free whatever the ticket still holds: its place in the queue or its worker."""
        queue = self._queue(ticket)
        if ticket in queue:
            queue.remove(ticket)
        if ticket.worker is not None and ticket.worker.ticket is ticket:
            ticket.worker.kill()

    def _retry_after(self) -> int:
        seconds = (len(self._waiting) + 1) * self._mean_seconds / self._count
        return max(1, min(60, math.ceil(seconds)))

    # ------------------------------------------------------------------------------- workers

    async def _tend(self, slot: int) -> None:
        """Keep one worker alive, for ever."""
        failures = 0
        while True:
            was_warm = False
            try:
                worker = await self._hire(slot)
                try:
                    await worker.gone.wait()
                finally:
                    was_warm = worker.warm
                    await self._bury(worker)
            except Exception:  # noqa: BLE001  (whatever it is, the next attempt may succeed)
                _log.exception("a worker could not be started or buried")
            failures = 0 if was_warm else failures + 1
            if failures >= _FAILURES:
                self._failing.add(slot)
            if failures:
                await asyncio.sleep(min(_FIRST_PAUSE * 2.0**failures, _LONGEST_PAUSE))

    async def _hire(self, slot: int) -> Worker:
        def on_message(worker: Worker, message: tuple[Any, ...]) -> None:
            if message[0] == Reply.READY:
                self._warmed.add(slot)
                self._failing.discard(slot)
            self._receive(worker, message)

        ours, theirs = socket.socketpair()
        with contextlib.ExitStack() as on_failure:
            on_failure.callback(ours.close)
            process = self._context.Process(
                target=main.main,
                args=(theirs, self._modules, self._warm),
                name=f"armwright-worker-{slot}",
                daemon=True,
            )
            async with self._starting:
                await in_thread(start, process, theirs)
            ours.setblocking(False)
            loop = asyncio.get_running_loop()
            _, worker = await loop.create_unix_connection(
                lambda: Worker(process, on_message), sock=ours
            )
            on_failure.pop_all()
        self.counters.started_workers += 1
        self._workers.add(worker)
        return worker

    async def _bury(self, worker: Worker) -> None:
        """Clear up after a worker that is gone, and settle the job that it had."""
        if worker in self._idle:
            self._idle.remove(worker)
        worker.kill()  # its stream may have ended before the process did
        ticket = worker.ticket
        if ticket is None or ticket.result.done():
            exit_code = None
        elif not ticket.arrived and ticket.attempts < _MAX_ATTEMPTS and self._accepting:
            exit_code = None
            self._put_back(ticket)
            self._dispatch()
        else:
            self.counters.crashed += 1
            exit_code = await in_thread(reap, worker.process)
            _log.warning(
                "worker %s died (%s) in %s", worker.process.pid, exit_code, ticket.job.task
            )
            ticket.settle(WorkerCrashed(ticket.job.task, exit_code))
        worker.ticket = None
        if exit_code is None:
            await in_thread(reap, worker.process)
        self._workers.discard(worker)

    def _receive(self, worker: Worker, message: tuple[Any, ...]) -> None:
        kind, *values = message
        ticket = worker.ticket
        if kind == Reply.READY:
            worker.warm = True
            self._free(worker)
        elif kind == Reply.UNFIT:
            _log.error("a worker could not warm up:\n%s", values[0])
        elif ticket is None or worker.doomed:
            return
        elif kind == Reply.STARTED:
            ticket.arrived, ticket.begun = True, time.monotonic()
            if ticket.background is not None:
                ticket.background.on_start()
        elif kind == Reply.PROGRESS:
            if ticket.on_progress is not None and not ticket.result.done():
                ticket.on_progress(*values)
        else:
            worker.ticket = None
            self._finish(ticket, Reply(kind), values)
            self._free(worker)

    def _finish(self, ticket: Ticket, kind: Reply, values: list[Any]) -> None:
        seconds = time.monotonic() - ticket.begun
        self._mean_seconds += _MEAN_WEIGHT * (seconds - self._mean_seconds)
        self.counters.finished += 1
        if kind == Reply.RESULT:
            ticket.settle(values[0])
        elif kind == Reply.FAULT:
            ticket.settle(from_fields(*values))
        else:
            ticket.settle(unexpected(ticket.job.task, values[0]))

    def _free(self, worker: Worker) -> None:
        if not worker.doomed:
            self._idle.append(worker)
            self._dispatch()
