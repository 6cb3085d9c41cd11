"""Runs the work of a request in a worker: for somebody who waits, or as part of a job."""

import asyncio
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from fastapi import Request

from service.http.errors import ProblemError
from service.settings import Settings
from service.workers.main import Job
from service.workers.process import Background, Progress
from service.workers.supervisor import WorkerSupervisor

#: How much longer than the request allows a worker lives that plans, so that the pipeline itself
#: says that the time was up, and what was tried [s].
GRACE = 0.5
#: What proxies log for a client that left; nobody sees it.
_CLIENT_LEFT = 499
#: Where in the scope of a request it stands that it is only looked at: would it be accepted?
DRY_RUN = "armwright.rehearsal"
#: Where in the scope of a request its `Errand` stands, if it is a job's.
ERRAND = "armwright.errand"


class DeferToJob(Exception):
    """A request that is only looked at came as far as its work, so it may become a job."""


@dataclass(frozen=True, slots=True)
class JobContext:
    """What the request of a job has in place of somebody who waits.

    Args:
        id: The job.
        deadline: When it must be done, on the clock of `time.monotonic` [s].
        on_start: Called when a worker begins with it.
        on_progress: Called with what the worker reports.
    """

    id: str
    deadline: float
    on_start: Callable[[], None]
    on_progress: Progress


def allowed(settings: Settings, timeout: float | None) -> float:
    """How long a request with this `timeout` may take [s].

    Raises:
        ProblemError: VALIDATION_ERROR, the timeout is longer than the service allows.
    """
    seconds = settings.default_timeout if timeout is None else timeout
    if seconds > settings.max_timeout:
        raise ProblemError(
            "VALIDATION_ERROR",
            f"timeout: {seconds:g} s is longer than the {settings.max_timeout:g} s allowed here",
            stage="request",
            hint=f"Ask for at most {settings.max_timeout:g} s.",
            max_timeout=settings.max_timeout,
        )
    return seconds


def postpone(request: Request) -> None:
    """End here if the request is only looked at.

    Raises:
        Postponed: It is.
    """
    if request.scope.get(DRY_RUN):
        raise DeferToJob


def errand(request: Request) -> JobContext | None:
    """What the request of a job is told by; None where somebody waits."""
    found: JobContext | None = request.scope.get(ERRAND)
    return found


async def compute(
    request: Request,
    job: Job,
    timeout: float | None = None,
    patience: float = 0.0,
    on_progress: Progress | None = None,
) -> Any:
    """The result of a job, computed in a worker within `timeout` [s].

    Args:
        request: On whose behalf; when its client leaves, the work is ended.
        job: What to call.
        timeout: As the request names it; the default of the service if left out. It begins when
            the request came, or for a job when a worker takes it up.
        patience: How much later the worker is ended, for work that minds the time itself [s].
        on_progress: Told of progress in place of the job that the request belongs to.

    Raises:
        ProblemError: As `WorkerSupervisor.submit`; PREEMPTED when the client left, in which case
            the worker was stopped.
        Postponed: The request is only looked at.
    """
    seconds = allowed(request.app.state.settings, timeout) + patience
    postpone(request)
    supervisor: WorkerSupervisor = request.app.state.supervisor
    away = errand(request)
    if away is not None:
        background = Background(seconds, away.on_start)
        return await supervisor.submit(job, math.inf, on_progress or away.on_progress, background)
    working = asyncio.ensure_future(supervisor.submit(job, time.monotonic() + seconds))
    leaving = asyncio.ensure_future(_disconnection(request))
    try:
        await asyncio.wait({working, leaving}, return_when=asyncio.FIRST_COMPLETED)
        if not working.done():
            raise ProblemError("PREEMPTED", "the client left", stage="worker", status=_CLIENT_LEFT)
        return working.result()
    finally:
        working.cancel()
        leaving.cancel()
        await asyncio.gather(working, leaving, return_exceptions=True)


async def _disconnection(request: Request) -> None:
    # The body has been read, so the only message there can still be is the last one.
    while (await request.receive())["type"] != "http.disconnect":
        pass
