"""Problems of jobs that have no result."""

import contextlib
import signal

from service.problem import ProblemError


class WorkerCrashed(ProblemError):
    """The worker died while it was working on this job."""

    def __init__(self, task: str, exit_code: int | None) -> None:
        cause = "it ended"
        if exit_code is not None and exit_code < 0:
            with contextlib.suppress(ValueError):
                cause = f"it was ended by {signal.Signals(-exit_code).name}"
        super().__init__(
            "CRASH",
            f"the worker process of this request died: {cause}",
            stage="worker",
            hint="It was replaced. If the same request does it again, report it.",
            task=task,
        )


class DeadlineExceeded(ProblemError):
    """The deadline passed before there was a result."""

    def __init__(self, task: str, where: str) -> None:
        super().__init__(
            "TIMED_OUT",
            f"the deadline passed while the request was {where}",
            stage=where,
            hint="Allow more time with the field timeout, or ask for less.",
            task=task,
        )


class QueueFull(ProblemError):
    """As many jobs as may wait are waiting."""

    def __init__(self, waiting: int, retry_after: int) -> None:
        super().__init__(
            "OVERLOADED",
            f"all workers are busy and {waiting} requests are waiting",
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
