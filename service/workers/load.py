"""Durations of tasks as they were measured, and the share that background jobs have."""

import time
from collections.abc import Iterable

from service.workers.process import Ticket

#: Weight of the newest job in the mean duration of its task.
_MEAN_WEIGHT = 0.1
#: Mean duration before any job of a task has run [s].
_FIRST_MEAN = 0.1
#: The share of the workers' time that background jobs have at least while they wait.
BACKGROUND_SHARE = 0.1
#: What background jobs are behind or ahead of their share is remembered up to this [s].
_MAX_BALANCE = 30.0


class Durations:
    """Mean durations of tasks; those of late count most."""

    def __init__(self) -> None:
        self._means: dict[str, float] = {}
        self._spreads: dict[str, float] = {}

    def note(self, task: str, seconds: float) -> None:
        """Note how long a job of a task took [s]."""
        mean = self._means.get(task, seconds)
        self._means[task] = mean + _MEAN_WEIGHT * (seconds - mean)
        spread = self._spreads.get(task, 0.0)
        self._spreads[task] = spread + _MEAN_WEIGHT * (abs(seconds - mean) - spread)

    def mean(self, task: str) -> float:
        """The mean duration of a task [s]."""
        return self._means.get(task, _FIRST_MEAN)

    def spread(self, task: str) -> float:
        """The mean deviation of the duration of a task from its mean [s]."""
        return self._spreads.get(task, 0.0)

    def remaining(self, running: Iterable[Ticket], waiting: Iterable[Ticket]) -> float:
        """Time that jobs still need, all together [s]."""
        now = time.monotonic()
        rest = sum(max(self.mean(t.job.task) - (now - t.begun), 0.0) for t in running)
        return rest + sum(self.mean(ticket.job.task) for ticket in waiting)


class BackgroundShare:
    """Account of the time that jobs nobody waits for have had, against their share."""

    def __init__(self) -> None:
        self._balance = 0.0

    @property
    def is_due(self) -> bool:
        """Whether a background job that waits is to be next, though others wait too."""
        return self._balance > 0.0

    def note(self, seconds: float, *, background: bool) -> None:
        """Note the time of a worker while background jobs wait or run [s]."""
        earned = (BACKGROUND_SHARE - 1.0 if background else BACKGROUND_SHARE) * seconds
        self._balance = max(-_MAX_BALANCE, min(_MAX_BALANCE, self._balance + earned))
