"""Runs the work of a request in a worker for as long as somebody waits for the answer."""

import asyncio
import time
from typing import Any

from fastapi import Request

from service.errors import ProblemError
from service.settings import Settings
from service.worker_main import Job
from service.workers import WorkerSupervisor

#: How much longer than the request allows a worker lives that plans, so that the pipeline itself
#: says that the time was up, and what was tried [s].
PATIENCE = 0.5
#: What proxies log for a client that left; nobody sees it.
_CLIENT_LEFT = 499


def deadline_of(settings: Settings, timeout: float | None) -> float:
    """When a request with this `timeout` [s] must be done, on the clock of `time.monotonic` [s].

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
    return time.monotonic() + seconds


async def compute(
    request: Request, job: Job, timeout: float | None = None, patience: float = 0.0
) -> Any:
    """The result of a job, computed in a worker within `timeout` [s].

    Args:
        request: On whose behalf; when its client leaves, the job is ended.
        job: What to call.
        timeout: As the request names it; the default of the service if left out.
        patience: How much later the worker is ended, for jobs that mind the time themselves [s].

    Raises:
        ProblemError: As `WorkerSupervisor.submit`; PREEMPTED when the client left, in which case
            the worker was stopped.
    """
    supervisor: WorkerSupervisor = request.app.state.supervisor
    deadline = deadline_of(request.app.state.settings, timeout) + patience
    working = asyncio.ensure_future(supervisor.submit(job, deadline))
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
