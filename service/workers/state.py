"""The state of a supervisor, as others may read it, and problems of jobs that have no result."""

import contextlib
import math
import signal
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from service.validation import ProblemError
from service.workers.load import BackgroundShare, Durations, FairQueue, InFlight
from service.workers.pool import Progress, WorkerPool
from service.workers.process import Ticket, Watcher, Worker
from service.workers.task import Job


def cause_of_death(exit_code: int | None) -> str:
    """The way in which a process ended, in words."""
    if exit_code is not None and exit_code < 0:
        with contextlib.suppress(ValueError):
            return f"it was ended by {signal.Signals(-exit_code).name}"
    return "it ended"


def was_ended_from_outside(exit_code: int | None) -> bool:
    """Whether others ended a process, as far as that can be seen.

    Signals that native code gives itself are left out: the same job would end the next one, too.

    Args:
        exit_code: Exit code as subprocess has it; None if it is not known.
    """
    return exit_code is None or exit_code in (-signal.SIGKILL, -signal.SIGTERM)


class WorkerCrashed(ProblemError):
    """The worker died while it was working on this job.

    Args:
        task: The name of the task.
        exit_code: Exit code of the worker, as subprocess has it; None if it is not known.
        earlier: How the workers of earlier attempts died.
    """

    def __init__(self, task: str, exit_code: int | None, earlier: Sequence[str] = ()) -> None:
        causes = [*earlier, cause_of_death(exit_code)]
        detail = f"the worker process of this request died: {causes[-1]}"
        if earlier:
            detail += f"; so it did at the first attempt: {earlier[0]}"
        super().__init__(
            "CRASH",
            detail,
            stage="worker",
            hint="It was replaced. If the same request does it again, report it.",
            task=task,
        )
        if earlier:
            self.details["causes"] = causes


class DeadlineExceeded(ProblemError):
    """The deadline passed before there was a result.

    Args:
        task: The name of the task.
        where: The request's place then, in words.
        earlier: How the workers of earlier attempts died.
    """

    def __init__(self, task: str, where: str, earlier: Sequence[str] = ()) -> None:
        detail = f"the deadline passed while the request was {where}"
        if earlier:
            detail += f", a second time: the worker that began with it died, {earlier[0]}"
        super().__init__(
            "TIMED_OUT",
            detail,
            stage=where,
            hint="Allow more time with the field timeout, or ask for less.",
            task=task,
        )
        if earlier:
            self.details["causes"] = list(earlier)


class QueueFull(ProblemError):
    """Too many jobs are waiting: as many as may, or so many that this one would be too late.

    Args:
        waiting: Jobs that wait.
        retry_after: Seconds after which the request would be accepted.
        wait: How long it would wait [s], where that is too long for its deadline.
    """

    def __init__(self, waiting: int, retry_after: int, wait: float | None = None) -> None:
        detail = f"all workers are busy and {waiting} requests are waiting"
        if wait is not None:
            detail += f": it would be {wait:.1f} s until this one begins, too late for its deadline"
        super().__init__(
            "OVERLOADED",
            detail,
            stage="queue",
            hint="Ask again after the time in Retry-After.",
            retry_after=retry_after,
        )


class ShuttingDown(ProblemError):
    """The service is about to end."""

    def __init__(self) -> None:
        super().__init__(
            "OVERLOADED",
            "the service is shutting down",
            stage="queue",
            hint="Ask again when it is back.",
            status=503,
            retry_after=1,
        )


class JobsFull(ProblemError):
    """As many jobs as are allowed wait or run."""

    def __init__(self, unfinished: int, workers: int) -> None:
        super().__init__(
            "OVERLOADED",
            f"{unfinished} jobs are waiting or running, and no more are accepted",
            stage="queue",
            hint="Ask again after the time in Retry-After, or cancel some of them.",
            retry_after=max(1, min(60, unfinished // workers)),
        )


#: Waits are taken for so many times what durations tell: a job that is begun in vain costs more
#: than one that is refused.
_CAUTION = 1.25
#: Longest time after which a refused request is told to ask again [s].
_MAX_RETRY = 60


@dataclass(slots=True)
class Counters:
    """Events that the supervisor has counted since it started."""

    finished: int = 0
    crashed: int = 0
    overrun: int = 0
    cancelled: int = 0
    rejected: int = 0
    yielded: int = 0
    recycled: int = 0


class SupervisorState:
    """Workers, queues and what is known of their load.

    Args:
        count: Jobs that may run at a time.
        queue_limit: Jobs that may wait while all workers are busy.
    """

    _pool: WorkerPool

    def __init__(self, count: int, queue_limit: int) -> None:
        self.counters = Counters()
        self.durations = Durations()
        self.in_flight = InFlight()
        self.watcher: Watcher | None = None
        self._count = count
        self._queue_limit = queue_limit
        self._brief: deque[Ticket] = deque()
        self._waiting = FairQueue()
        self._background: deque[Ticket] = deque()
        self._share = BackgroundShare()
        self._idle: list[Worker] = []
        self._accepting = False

    @property
    def ready(self) -> bool:
        """Whether every worker has been warm once and none fails to start."""
        return self._accepting and self._pool.ready

    @property
    def settled(self) -> bool:
        """Whether those workers live that stay, as long as nobody ends them."""
        return self._pool.settled

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
        return len(self._brief) + self._waiting.count

    @property
    def background_waiting(self) -> int:
        """Background jobs that wait for a worker."""
        return len(self._background)

    @property
    def has_work(self) -> bool:
        """Whether somebody waits for a job that runs, waits or is on its way."""
        return self.in_flight.count + self._waiting.count + self.busy > 0

    @property
    def is_free(self) -> bool:
        """Whether a job could be begun at once, and no other is on its way."""
        return not self.has_work and self._can_begin()

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
        count = 0
        for worker in self._pool.workers:  # no generator: each request is judged by this
            if worker.ticket is not None and not worker.ticket.brief:
                count += 1
        return count

    @property
    def pids(self) -> list[int]:
        """The process numbers of the workers that live."""
        return self._pool.pids

    @property
    def busy_pids(self) -> list[int]:
        """The process numbers of the workers that have a job."""
        return [worker.process.pid for worker in self._pool.workers if has_long_job(worker)]

    # ------------------------------------------------------------------------------ estimates

    def expected_wait(self, client: str = "") -> float:
        """Time until a new job of a client would begin, as far as durations tell [s]."""
        if self._can_begin():
            return 0.0
        return self._work(client)

    def refusal(self, job: Job[Any], client: str = "") -> QueueFull | None:
        """The problem of a job that has no chance; None where it has one.

        Args:
            job: The call.
            client: Whom it is for.
        """
        if self._can_begin():
            return None
        wait = self.expected_wait(client)
        return self._refusal((job.task, job.size), job.deadline.remaining, wait, self.waiting)

    def early_refusal(
        self, task: str, seconds: float, client: str = "", size: int = 0
    ) -> QueueFull | None:
        """The problem of a request that has just arrived; None where it has a chance.

        Requests that are still being read count as if they waited.

        Args:
            task: Task that the request asks for.
            seconds: Time until its deadline [s].
            client: Whom it is from.
            size: Size of the body [byte]; 0 where it is not known.
        """
        running = sum(1 for _ in self._running())
        queued = self._waiting.count + running
        ahead = self.in_flight.ahead(client, queued)
        if self._can_begin() and running + ahead < self._count:
            return None
        wait = self.expected_wait(client) + ahead * self.durations.mean(task, size) / self._count
        waiting = self.waiting + max(self.in_flight.count - queued, 0)
        return self._refusal((task, size), seconds, wait, waiting)

    def _refusal(
        self, kind: tuple[str, int], seconds: float, wait: float, waiting: int
    ) -> QueueFull | None:
        """The refusal of a job, by the name of its task and the size of its request [byte]."""
        duration = self.durations.mean(*kind) + self.durations.spread(*kind)
        late, told = _CAUTION * wait + duration - seconds, None
        if waiting >= self._queue_limit:
            late = self._work(None) / max(waiting, 1)
        elif late > 0.0 and wait > 0.0:
            told = wait
        else:
            return None
        self.counters.rejected += 1
        return QueueFull(waiting, _retry_after(late), told)

    def _work(self, client: str | None) -> float:
        """Time that workers need for what is before a new job of a client, or for all [s]."""
        waiting = self._waiting if client is None else self._waiting.ahead(client)
        return self.durations.remaining(self._running(), waiting) / self._count

    def _running(self) -> Iterator[Ticket]:
        """The jobs that run and for which somebody waits, brief ones left out."""
        for worker in self._pool.workers:
            ticket = worker.ticket
            if ticket is not None and has_long_job(worker) and ticket.background is None:
                yield ticket

    def _next_queue(self) -> "deque[Ticket] | FairQueue | None":
        """The queue whose first job a worker can be given now."""
        if not (self._waiting.count or self._brief or self._background):
            return None
        if self._brief and self._can_begin("brief"):
            return self._brief
        background = bool(self._background) and self._can_begin("background")
        if background and self._share.is_due and not self._has_share():
            return self._background
        if self._waiting.count:
            return self._waiting if self._can_begin() else None
        return self._background if background else None

    def _has_few_long_jobs(self) -> bool:
        """Whether fewer jobs run that are not brief than may run at a time."""
        count = 0
        for worker in self._pool.workers:
            if worker.ticket is not None and not worker.ticket.brief and not worker.ending:
                count += 1
        return count < self._count

    def _has_share(self) -> bool:
        """Whether a background job runs that gives way to nobody."""
        tickets = (worker.ticket for worker in self._pool.workers)
        return any(ticket is not None and ticket.has_share for ticket in tickets)

    def _can_begin(self, kind: str = "waiting") -> bool:
        """Whether a job could be given to a worker now.

        Args:
            kind: "brief", "waiting" or "background". While background jobs hold workers, a spare
                one takes a job that somebody waits for.
        """
        for worker in self._idle:
            if not worker.ending:
                break
        else:
            return False
        if kind == "brief" or self._has_few_long_jobs():
            return True
        return kind == "waiting" and sum(1 for _ in self._running()) < self._count


def has_long_job(worker: Worker) -> bool:
    """Whether a worker has a job that is not brief."""
    return worker.ticket is not None and not worker.ticket.brief and not worker.ending


def _retry_after(seconds: float) -> int:
    return max(1, min(_MAX_RETRY, math.ceil(seconds)))
