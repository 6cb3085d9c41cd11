"""Problems of jobs that have no result."""

import contextlib
import signal
from collections.abc import Sequence

from service.problem import ProblemError


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
