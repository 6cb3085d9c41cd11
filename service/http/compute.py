"""The work of a request, done in a worker: for a client that waits, or as part of a job."""

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator
from typing import TypeVar

from fastapi import Request

from planning.values.deadline import Deadline
from service.access.authentication import client_of
from service.http.layer.admission import Admission
from service.http.layer.request_checks import ARRIVAL
from service.http.state import end_dry_run, job_context, settings_of, supervisor_of
from service.settings import Settings
from service.validation import ProblemError, request_problem
from service.workers.process import Background, OnProgress
from service.workers.task import Job

_R = TypeVar("_R")

#: What proxies log for a client that left; nobody sees it.
_CLIENT_LEFT = 499
#: Parts of a job are one of many: nobody sees the progress of those that take less than this [s].
_SILENCE = 0.05


def allowed_time(settings: Settings, timeout: float | None) -> float:
    """Time that a request with this `timeout` may take [s].

    Raises:
        ProblemError: VALIDATION_ERROR, the timeout is longer than the service allows.
    """
    seconds = settings.default_timeout if timeout is None else timeout
    if seconds > settings.max_timeout:
        raise request_problem(
            "VALIDATION_ERROR",
            f"timeout: {seconds:g} s is longer than the {settings.max_timeout:g} s allowed here",
            hint=f"Ask for at most {settings.max_timeout:g} s.",
            max_timeout=settings.max_timeout,
        )
    return seconds


async def compute(
    request: Request,
    job: Job[_R],
    timeout: float | None = None,
    on_progress: OnProgress | None = None,
) -> _R:
    """The result of a job, computed in a worker within `timeout` [s].

    Args:
        request: Request on whose behalf; when its client leaves, the work is ended.
        job: The call.
        timeout: Timeout as the request names it; the default of the service if left out. It begins
            when the first byte of the request came, or for a job when a worker takes it up.
        on_progress: Called with progress, in place of the job that the request belongs to.

    Raises:
        ProblemError: As `WorkerSupervisor.submit`; PREEMPTED when the client left, in which case
            the worker was stopped.
        DeferToJob: The request is only checked.
    """
    seconds = allowed_time(settings_of(request), timeout)
    end_dry_run(request)
    supervisor = supervisor_of(request)
    context = job_context(request)
    if context is not None:
        silence = 0.0 if on_progress is None else _SILENCE
        background = Background(seconds, context.on_start, silence)
        return await supervisor.submit(job, on_progress or context.on_progress, background)
    admission: Admission = request.app.state.admission
    admission.record_task(request.method, request.scope["path"], job.task)
    timed = job.with_deadline(deadline_of(request, seconds))
    async with _ending_with_client(request):
        return await supervisor.submit(timed, client=client_of(request.scope))


async def compute_at_once(request: Request, job: Job[_R]) -> _R:
    """The result of a job that takes a millisecond, though all workers have work.

    Raises:
        ProblemError: As `WorkerSupervisor.submit`.
    """
    deadline = deadline_of(request, settings_of(request).default_timeout)
    return await supervisor_of(request).submit(
        job.with_deadline(deadline), brief=True, client=client_of(request.scope)
    )


def deadline_of(request: Request, seconds: float) -> Deadline:
    """The deadline of a request that may take so many seconds from its first byte on."""
    arrival: float = request.scope.get(ARRIVAL) or time.monotonic()
    return Deadline(arrival + seconds)


@contextlib.asynccontextmanager
async def _ending_with_client(request: Request) -> AsyncIterator[None]:
    """Context in which what is awaited is cancelled when the client leaves.

    Args:
        request: Request of the client.

    Raises:
        ProblemError: PREEMPTED, it left.
    """
    awaiting, has_left = asyncio.current_task(), False
    assert awaiting is not None

    async def watch() -> None:
        nonlocal has_left
        # The body has been read, so the only message there can still be is the last one; and
        # whatever is wrong with the connection, nobody can be answered on it.
        with contextlib.suppress(Exception):
            while (await request.receive())["type"] != "http.disconnect":
                pass
        has_left = True
        awaiting.cancel()

    watching = asyncio.create_task(watch())
    try:
        yield
    except asyncio.CancelledError:
        if not has_left or awaiting.uncancel() > 0:
            raise
        raise ProblemError(
            "PREEMPTED", "the client left", stage="worker", status=_CLIENT_LEFT
        ) from None
    finally:
        watching.cancel()
