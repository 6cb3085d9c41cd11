"""The supervisor of the worker processes: it gives them jobs, one at a time.

Every worker is a process of its own with one stream to the server. All bookkeeping happens on the
event loop: a worker is starting, idle or has one ticket; when its stream ends it is dead, whatever
the reason, and the pool starts another in its place. Nothing is shared between workers, so nothing
that happens to one can be noticed by the request of another.
"""

import asyncio
import logging
import math
import time
from collections import deque
from collections.abc import Sequence
from typing import Any, TypeVar, cast

from planning.values.deadline import Deadline
from service.validation import from_fields, unexpected_fault
from service.workers.fork.launch import Launched, Recipe
from service.workers.load import FairQueue
from service.workers.main import Reply, is_refusal
from service.workers.pool import WorkerPool
from service.workers.process import (
    DEFAULT_LIMITS,
    EXIT_TIMEOUT,
    Background,
    OnProgress,
    Ticket,
    Worker,
    WorkerLimits,
    is_worn,
)
from service.workers.state import (
    DeadlineExceeded,
    QueueFull,
    ShuttingDown,
    SupervisorState,
    WorkerCrashed,
    cause_of_death,
    was_ended_from_outside,
)
from service.workers.task import Job, pack_job

_R = TypeVar("_R")

_log = logging.getLogger(__name__)

#: A worker that dies before a job has reached it is not the job's fault; but a job that can't even
#: be received must not go round for ever.
_MAX_ATTEMPTS = 3
#: A request that has waited so long takes the worker of a background job [s]: longer than most
#: requests need, shorter than a person notices.
_YIELD_AFTER = 0.05
#: A job that has waited is begun if this part of its mean duration is left until its deadline.
_LEAST_PART = 0.7
#: Timers may be early by the resolution of their clock [s].
_CLOCK_STEP = 0.005
#: How often one background job gives way and begins anew; then it runs to its end.
_MAX_YIELDS = 3


class WorkerSupervisor(SupervisorState):
    """Runs jobs in worker processes, and keeps the workers alive.

    Jobs for which somebody waits go first, one of each client in turn. Background jobs may hold all
    workers; a spare one takes what somebody waits for then, and where that is not enough, the
    background job that began last gives way and begins anew later. While background jobs wait, they
    have a tenth of the workers' time at least.

    Args:
        count: Worker processes.
        queue_limit: Jobs that may wait while all workers are busy.
        kill_grace: How far a job may overrun its deadline and grace before its worker is killed
            [s].
        recipe: Recipe of what workers need, loaded once by the fork server.
        launched: A fork server with this recipe that was started already.
        spares: Worker processes beyond that number. They are warm when a worker has to be replaced,
            and take brief jobs while all others have work.
        limits: Limits of each worker.
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
        limits: WorkerLimits = DEFAULT_LIMITS,
    ) -> None:
        super().__init__(count, queue_limit)
        self._pool = WorkerPool(count + spares, self, recipe, launched, limits)
        self._limits = limits
        self._kill_grace = kill_grace

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
        client: str = "",
    ) -> _R:
        """Run a job in a worker.

        When the caller is cancelled, the job is taken from the queue, or its worker is killed.

        Args:
            job: The call; its deadline begins to count now.
            on_progress: Called on the event loop with the progress that the task reports.
            background: Given where nobody waits. The queue has no limit for these; whoever
                submits them minds their number.
            brief: Whether the job takes a millisecond or so. Brief jobs go first, and a spare
                worker
                takes them while all others have work.
            client: Whom it is for; clients take turns.

        Returns:
            The result of the task.

        Raises:
            QueueFull: Too many jobs are waiting, or so many that this one would be too late.
            DeadlineExceeded: The deadline passed.
            WorkerCrashed: The worker died.
            ShuttingDown: The supervisor is being stopped, or was not started.
            ProblemError: The task raised: the caller's fault, or CRASH with the reference under
                which a fault of the service was logged.
        """
        if not self._accepting:
            raise ShuttingDown
        if background is None:
            self._admit(job, client, brief=brief)
        loop = asyncio.get_running_loop()
        payload = pack_job(job)
        future: asyncio.Future[Any] = loop.create_future()
        ticket = Ticket(
            job, job.deadline, payload, future, on_progress, background, brief, client=client
        )
        if self.watcher is not None:
            ticket.watch = self.watcher(job.task)
        self._queue(ticket).append(ticket)
        self._dispatch()
        yield_timer = None
        if ticket.worker is None:
            # What a worker has got has a timer of its own.
            self._set_timer(ticket, ticket.ends_at)
            if background is None:
                yield_timer = loop.call_later(_YIELD_AFTER, self._take_worker_for, ticket)
        try:
            return cast(_R, await ticket.result)
        finally:
            if yield_timer is not None:
                yield_timer.cancel()
            self._withdraw(ticket)

    # ------------------------------------------------------------------------------- tickets

    def _admit(self, job: Job[Any], client: str, *, brief: bool) -> None:
        """Let a job wait only where it has a chance.

        Raises:
            QueueFull: It has none.
        """
        if not brief:
            problem = self.refusal(job, client)
            if problem is not None:
                raise problem
        elif not self._can_begin("brief") and self.waiting >= self._queue_limit:
            self.counters.rejected += 1
            raise QueueFull(self.waiting, 1)

    def _queue(self, ticket: Ticket) -> "deque[Ticket] | FairQueue":
        if ticket.brief:
            return self._brief
        return self._waiting if ticket.background is None else self._background

    def _dispatch(self) -> None:
        while (queue := self._next_queue()) is not None:
            worker = self._idle.pop()
            if worker.ending:
                continue
            if self._end_if_worn(worker):
                continue
            ticket = queue.popleft()
            if self._is_too_late(ticket):
                self._idle.append(worker)
                self.counters.rejected += 1
                ticket.settle(QueueFull(self.waiting, 1, 0.0))
                continue
            ticket.has_share = ticket.background is not None and self._share.is_due
            ticket.worker, worker.ticket = worker, ticket
            ticket.attempts += 1
            if ticket.background is not None:
                ticket.deadline = Deadline.after(ticket.background.allowance)
            ticket.begun = time.monotonic()
            worker.send(ticket)  # first: it begins while the rest is done here
            self._set_timer(ticket, ticket.deadline.at + self._kill_grace)

    def _is_too_late(self, ticket: Ticket) -> bool:
        """Whether a job that has waited can't be done any more, as far as durations tell."""
        if ticket.brief or ticket.background is not None or ticket.attempts > 0:
            return False
        if time.monotonic() - ticket.begun <= _CLOCK_STEP:
            return False
        mean = self.durations.mean(ticket.job.task, ticket.job.size)
        return ticket.deadline.remaining < _LEAST_PART * mean

    def _take_worker_for(self, waiting: Ticket) -> None:
        """Take the worker of the background job that began last, for a request that waits."""
        if waiting not in self._queue(waiting):
            return
        yielding = [
            worker
            for worker in self._pool.workers
            if worker.ticket is not None
            and not worker.ending
            and worker.ticket.background is not None
            and worker.ticket.yields < _MAX_YIELDS
            and not worker.ticket.has_share
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
        ticket.worker, ticket.arrived, ticket.has_share = None, False, False
        if ticket.watch is not None:
            ticket.watch.waits()
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
        """End a job that is late, at the end of its grace; at once if its worker was stopped."""
        if ticket.offer is not None:
            # What was found is answered in time, whatever the worker is at.
            self.counters.overrun += 1
            ticket.settle(ticket.offer)
            self._release(ticket)
            return
        ends_at = ticket.ends_at + self._kill_grace
        has_grace = time.monotonic() < ends_at - _CLOCK_STEP
        if has_grace and ticket.worker is not None and not ticket.worker.process.is_stopped:
            self._set_timer(ticket, ends_at)
            return
        self.counters.overrun += 1
        where = "waiting for a worker" if ticket.worker is None else "being computed"
        if ticket.worker is not None:
            self._note_duration(ticket, time.monotonic() - ticket.begun)
        ticket.settle(DeadlineExceeded(ticket.job.task, where, ticket.causes))
        self._release(ticket)

    def _withdraw(self, ticket: Ticket) -> None:
        if ticket.timer is not None:
            ticket.timer.cancel()
        if ticket.result.cancelled():
            self.counters.cancelled += 1
        if ticket.watch is not None:
            ticket.watch.ends(ticket.outcome)
        self._release(ticket)

    def _release(self, ticket: Ticket) -> None:
        """Free the place of a ticket in the queue, or its worker."""
        worker = ticket.worker
        if worker is None:
            queue = self._queue(ticket)
            if ticket in queue:
                queue.remove(ticket)
        elif worker.ticket is ticket:
            worker.kill()
            self._dispatch()

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
        if ticket.offer is not None:
            self.counters.crashed += 1
            ticket.settle(ticket.offer)
            return
        if not ticket.arrived and ticket.attempts < _MAX_ATTEMPTS and self._accepting:
            worker.ticket = None
            self._put_back(ticket)
            self._dispatch()
            return
        self.counters.crashed += 1
        exit_code = await worker.process.exit_code(EXIT_TIMEOUT)
        _log.warning("worker %s died (%s) in %s", worker.process.pid, exit_code, ticket.job.task)
        if ticket.result.done():
            return
        if self._gets_second_attempt(ticket, exit_code):
            ticket.causes.append(cause_of_death(exit_code))
            worker.ticket = None
            self._put_back(ticket)
            self._dispatch()
            return
        ticket.settle(WorkerCrashed(ticket.job.task, exit_code, ticket.causes))

    def _gets_second_attempt(self, ticket: Ticket, exit_code: int | None) -> bool:
        """Whether a job whose worker has died is begun once more.

        One for which somebody waits is, where it did not end its worker itself and there is time.
        """
        if ticket.causes or not self._accepting:
            return False
        if ticket.background is not None:
            return True
        return was_ended_from_outside(exit_code) and ticket.deadline.remaining > 0.0

    def message_received(self, worker: Worker, kind: Reply, values: Sequence[Any]) -> None:
        """Pass on the message of a worker about its job."""
        ticket = worker.ticket
        if ticket is None or worker.ending:
            return
        if kind == Reply.STARTED:
            ticket.arrived, ticket.begun = True, time.monotonic()
            if ticket.watch is not None:
                ticket.watch.begins()
            if ticket.background is not None:
                ticket.background.on_start()
        elif kind == Reply.PROGRESS:
            ticket.note_progress(*values)
        elif kind == Reply.OFFER:
            ticket.offer = values[0]
        else:
            worker.ticket = None
            worker.jobs += 1
            self._finish(ticket, kind, values)
            worker.may_be_worn = True
            self._free(worker)
            # Behind who waits for the answer, who is next on the event loop.
            asyncio.get_running_loop().call_soon(self._end_if_worn, worker)

    def _end_if_worn(self, worker: Worker) -> bool:
        """Have another worker take the place of one that its last job has worn.

        It is looked at once after each job: when it is idle, or before it gets the next one.
        """
        is_unknown, worker.may_be_worn = worker.may_be_worn, False
        if not is_unknown or worker.ending or not is_worn(worker, self._limits):
            return False
        self.counters.recycled += 1
        worker.kill()
        return True

    def _finish(self, ticket: Ticket, kind: Reply, values: Sequence[Any]) -> None:
        seconds, *outcome = values
        self._note_duration(ticket, seconds, is_refusal=is_refusal(kind, outcome[0]))
        self.counters.finished += 1
        if kind == Reply.RESULT:
            ticket.settle(outcome[0])
        elif kind == Reply.FAULT:
            ticket.settle(from_fields(*outcome))
        else:
            ticket.settle(unexpected_fault(ticket.job.task, outcome[0]))

    def _note_duration(self, ticket: Ticket, seconds: float, *, is_refusal: bool = False) -> None:
        if not ticket.brief and not is_refusal:
            self.durations.note(ticket.job.task, seconds, ticket.job.size)
        if self._background or ticket.background is not None:
            self._share.note(seconds, background=ticket.background is not None)

    def _free(self, worker: Worker) -> None:
        if not worker.ending:
            self._idle.append(worker)
            self._dispatch()
