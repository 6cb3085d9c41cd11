"""The supervisor of the worker processes: it gives them jobs, one at a time.

Every worker is a process of its own with one stream to the server. All bookkeeping happens on the
event loop: a worker is starting, idle or has one ticket; when its stream ends it is dead, whatever
the reason, and the pool starts another in its place. Nothing is shared between workers, so nothing
that happens to one can be noticed by the request of another.
"""

import asyncio
import logging
import math
import pickle
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar, cast

from planning.deadline import Deadline
from service.problem import from_fields, unexpected_fault
from service.workers.faults import DeadlineExceeded, QueueFull, ShuttingDown, WorkerCrashed
from service.workers.launch import Launched, Recipe
from service.workers.main import Reply
from service.workers.pool import Progress, WorkerPool
from service.workers.process import EXIT_TIMEOUT, Background, OnProgress, Ticket, Worker
from service.workers.task import Job

_R = TypeVar("_R")

_log = logging.getLogger(__name__)

#: A worker that dies before a job has reached it is not the job's fault; but a job that can't even
#: be received must not go round for ever.
_MAX_ATTEMPTS = 3
#: Weight of the newest job in the mean duration.
_MEAN_WEIGHT = 0.1
#: Mean duration before any job has run [s].
_FIRST_MEAN = 0.1
#: Longest time after which a refused request is told to ask again [s].
_MAX_RETRY = 60
#: A request that has waited so long takes the worker of a background job [s]: longer than most
#: requests need, shorter than a person notices.
_YIELD_AFTER = 0.2
#: How often one background job gives way and begins anew; then it runs to its end.
_MAX_YIELDS = 3


@dataclass(slots=True)
class Counters:
    """Events that the supervisor has counted since it started."""

    finished: int = 0
    crashed: int = 0
    overrun: int = 0
    cancelled: int = 0
    rejected: int = 0
    yielded: int = 0


class WorkerSupervisor:
    """Runs jobs in worker processes, and keeps the workers alive.

    Jobs for which somebody waits go first. Background jobs may hold all workers; where somebody
    waits nevertheless, the one that began last gives way and begins anew later.

    Args:
        count: Worker processes.
        queue_limit: Jobs that may wait while all workers are busy.
        kill_grace: How far a job may overrun its deadline and grace before its worker is killed
            [s].
        recipe: What workers need, loaded once by the fork server.
        launched: A fork server with this recipe that was started already.
        spares: Worker processes beyond that number. They are warm when a worker has to be replaced,
            and take brief jobs while all others have work.
    """

    def __init__(
        self,
        count: int,
        queue_limit: int,
        *,
        spares: int = 0,
        recipe: Recipe,
        launched: Launched | None = None,
        kill_grace: float = 0.1,
    ) -> None:
        self.counters = Counters()
        self._pool = WorkerPool(count + spares, self, recipe, launched)
        self._count = count
        self._queue_limit = queue_limit
        self._kill_grace = kill_grace
        self._brief: deque[Ticket] = deque()
        self._waiting: deque[Ticket] = deque()
        self._background: deque[Ticket] = deque()
        self._idle: list[Worker] = []
        self._accepting = False
        self._mean_seconds = _FIRST_MEAN

    @property
    def ready(self) -> bool:
        """Whether every worker has been warm once and none fails to start."""
        return self._accepting and self._pool.ready

    @property
    def progress(self) -> Progress | None:
        """Progress of compiling, while the workers wait for it."""
        return self._pool.progress

    @property
    def unfit(self) -> bool:
        """Whether workers can't start, for a reason that was logged."""
        return self._pool.unfit

    @property
    def waiting(self) -> int:
        """Jobs that wait for a worker and for which somebody waits."""
        return len(self._brief) + len(self._waiting)

    @property
    def background_waiting(self) -> int:
        """Background jobs that wait for a worker."""
        return len(self._background)

    @property
    def count(self) -> int:
        """Number of jobs that may run at a time; brief ones are not counted."""
        return self._count

    @property
    def alive(self) -> int:
        """Number of workers that could run a job now."""
        return min(len(self._pool.pids), self._count)

    @property
    def spare(self) -> int:
        """Worker processes that live beyond those."""
        return max(len(self._pool.pids) - self._count, 0)

    @property
    def started_workers(self) -> int:
        """Worker processes that were started; beyond the first ones, replacements."""
        return self._pool.started

    @property
    def busy(self) -> int:
        """Workers that have a job, other than a brief one."""
        tickets = (worker.ticket for worker in self._pool.workers)
        return sum(ticket is not None and not ticket.brief for ticket in tickets)

    @property
    def pids(self) -> list[int]:
        """The process numbers of the workers that live."""
        return self._pool.pids

    @property
    def busy_pids(self) -> list[int]:
        """The process numbers of the workers that have a job."""
        return [worker.process.pid for worker in self._pool.workers if _has_long_job(worker)]

    async def start(self) -> None:
        """Start the workers, without waiting until they are ready."""
        self._accepting = True
        self._pool.start()

    async def stop(self) -> None:
        """Refuse all jobs, running ones included, and end the workers."""
        self.abandon()
        await self._pool.stop()

    def abandon(self) -> None:
        """Accept no more jobs and tell those that wait or run that the service is ending."""
        self._accepting = False
        running = [worker.ticket for worker in self._pool.workers if worker.ticket is not None]
        for ticket in [*self._brief, *self._waiting, *self._background, *running]:
            ticket.settle(ShuttingDown())

    async def submit(
        self,
        job: Job[_R],
        on_progress: OnProgress | None = None,
        background: Background | None = None,
        *,
        brief: bool = False,
    ) -> _R:
        """Run a job in a worker.

        When the caller is cancelled, the job is taken from the queue, or its worker is killed.

        Args:
            job: The call; its deadline begins to count now.
            on_progress: Called on the event loop with the progress that the task reports.
            background: Given where nobody waits. The queue has no limit for these; whoever
                submits them minds their number.
            brief: Whether it takes a millisecond or so. Brief jobs go first, and a spare worker
                takes them while all others have work.

        Returns:
            The result of the task.

        Raises:
            QueueFull: Too many jobs are waiting.
            DeadlineExceeded: The deadline passed.
            WorkerCrashed: The worker died.
            ShuttingDown: The supervisor is being stopped, or was not started.
            ProblemError: The task raised: the caller's fault, or CRASH with the reference under
                which a fault of the service was logged.
        """
        if not self._accepting:
            raise ShuttingDown
        if background is None and not self._can_begin(brief) and self.waiting >= self._queue_limit:
            self.counters.rejected += 1
            raise QueueFull(self.waiting, self._retry_after())
        loop = asyncio.get_running_loop()
        payload = pickle.dumps(job, pickle.HIGHEST_PROTOCOL)
        future: asyncio.Future[Any] = loop.create_future()
        ticket = Ticket(job, job.deadline, payload, future, on_progress, background, brief)
        self._set_timer(ticket, ticket.ends_at)
        self._queue(ticket).append(ticket)
        self._dispatch()
        yield_timer = None
        if background is None and not brief and ticket.worker is None:
            yield_timer = loop.call_later(_YIELD_AFTER, self._take_worker_for, ticket)
        try:
            return cast(_R, await ticket.result)
        finally:
            if yield_timer is not None:
                yield_timer.cancel()
            self._withdraw(ticket)

    # ------------------------------------------------------------------------------- tickets

    def _queue(self, ticket: Ticket) -> deque[Ticket]:
        if ticket.brief:
            return self._brief
        return self._waiting if ticket.background is None else self._background

    def _can_begin(self, brief: bool) -> bool:
        """Whether a job could be given to a worker now."""
        if not any(not worker.ending for worker in self._idle):
            return False
        return brief or sum(map(_has_long_job, self._pool.workers)) < self._count

    def _dispatch(self) -> None:
        while True:
            queue = self._brief or self._waiting or self._background
            if not queue or not self._can_begin(brief=queue is self._brief):
                return
            worker = self._idle.pop()
            if worker.ending:
                continue
            ticket = queue.popleft()
            ticket.worker, worker.ticket = worker, ticket
            ticket.attempts += 1
            if ticket.background is not None:
                ticket.deadline = Deadline.after(ticket.background.allowance)
            self._set_timer(ticket, ticket.ends_at + self._kill_grace)
            worker.send(ticket)

    def _take_worker_for(self, waiting: Ticket) -> None:
        """Take the worker of the background job that began last, for a request that waits."""
        if waiting not in self._waiting:
            return
        yielding = [
            worker
            for worker in self._pool.workers
            if worker.ticket is not None
            and not worker.ending
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
        self._dispatch()

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
        self._release(ticket)

    def _withdraw(self, ticket: Ticket) -> None:
        if ticket.timer is not None:
            ticket.timer.cancel()
        if ticket.result.cancelled():
            self.counters.cancelled += 1
        self._release(ticket)

    def _release(self, ticket: Ticket) -> None:
        """Free the place of a ticket in the queue, or its worker."""
        queue = self._queue(ticket)
        if ticket in queue:
            queue.remove(ticket)
        if ticket.worker is not None and ticket.worker.ticket is ticket:
            ticket.worker.kill()
            self._dispatch()

    def _retry_after(self) -> int:
        seconds = (self.waiting + 1) * self._mean_seconds / self._count
        return max(1, min(_MAX_RETRY, math.ceil(seconds)))

    # ------------------------------------------------------------------------ owner of the pool

    def worker_ready(self, worker: Worker) -> None:
        """Give a worker that is warm its first job."""
        self._free(worker)

    def retire(self, worker: Worker) -> bool:
        """End a worker that has no job."""
        if worker not in self._idle:
            return False
        self._idle.remove(worker)
        worker.kill()
        return True

    async def worker_lost(self, worker: Worker) -> None:
        """Settle the job of a worker that has ended, or have it wait for another worker."""
        if worker in self._idle:
            self._idle.remove(worker)
        self._dispatch()
        ticket = worker.ticket
        if ticket is None or ticket.result.done():
            return
        if not ticket.arrived and ticket.attempts < _MAX_ATTEMPTS and self._accepting:
            worker.ticket = None
            self._put_back(ticket)
            self._dispatch()
            return
        self.counters.crashed += 1
        exit_code = await worker.process.exit_code(EXIT_TIMEOUT)
        _log.warning("worker %s died (%s) in %s", worker.process.pid, exit_code, ticket.job.task)
        ticket.settle(WorkerCrashed(ticket.job.task, exit_code))

    def message_received(self, worker: Worker, kind: Reply, values: Sequence[Any]) -> None:
        """Pass on the message of a worker about its job."""
        ticket = worker.ticket
        if ticket is None or worker.ending:
            return
        if kind == Reply.STARTED:
            ticket.arrived, ticket.begun = True, time.monotonic()
            if ticket.background is not None:
                ticket.background.on_start()
        elif kind == Reply.PROGRESS:
            if ticket.on_progress is not None and not ticket.result.done():
                ticket.on_progress(*values)
        else:
            worker.ticket = None
            self._finish(ticket, kind, values)
            self._free(worker)

    def _finish(self, ticket: Ticket, kind: Reply, values: Sequence[Any]) -> None:
        seconds = time.monotonic() - ticket.begun
        self._mean_seconds += _MEAN_WEIGHT * (seconds - self._mean_seconds)
        self.counters.finished += 1
        if kind == Reply.RESULT:
            ticket.settle(values[0])
        elif kind == Reply.FAULT:
            ticket.settle(from_fields(*values))
        else:
            ticket.settle(unexpected_fault(ticket.job.task, values[0]))

    def _free(self, worker: Worker) -> None:
        if not worker.ending:
            self._idle.append(worker)
            self._dispatch()


def _has_long_job(worker: Worker) -> bool:
    return worker.ticket is not None and not worker.ticket.brief and not worker.ending
