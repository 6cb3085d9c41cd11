"""Requests that belong to jobs: where they stand in the scope of a request."""

from collections.abc import Callable
from dataclasses import dataclass

from fastapi import Request

from service.access.caller import ANYONE, Caller

#: Key in the scope of a request that is only checked: would it be accepted as a job?
DRY_RUN = "armwright.dry_run"
#: Key in the scope of a job's request, with its `JobContext`.
JOB_CONTEXT = "armwright.job"


class DeferToJob(Exception):
    """A request that is only checked came as far as its work, so it may become a job."""


@dataclass(frozen=True, slots=True)
class JobContext:
    """The job on whose behalf a request is answered, in place of a client that waits.

    Args:
        id: The job.
        deadline: When it must be done, on the clock of `time.monotonic` [s].
        on_start: Called when a worker begins with it.
        on_progress: Called with the progress, from 0 to 1, and the stage that a worker reports.
        caller: Whose job it is.
        first: Index of its first problem in the batch that it is a chunk of.
    """

    id: str
    deadline: float
    on_start: Callable[[], None]
    on_progress: Callable[[float, str], None]
    caller: Caller = ANYONE
    first: int = 0


def job_context(request: Request) -> JobContext | None:
    """The job that a request belongs to; None where a client waits."""
    context: JobContext | None = request.scope.get(JOB_CONTEXT)
    return context


def end_dry_run(request: Request) -> None:
    """End here if the request is only checked.

    Raises:
        DeferToJob: It is.
    """
    if request.scope.get(DRY_RUN):
        raise DeferToJob
