"""Health, readiness and metrics."""

import math

from fastapi import Request, Response
from prometheus_client import CONTENT_TYPE_PLAIN_0_0_4
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from armwright_wire.base import Answer
from service.access.authentication import caller_of
from service.http.json_route import json_router
from service.http.metrics import Metrics, jobs_text
from service.http.state import store_of, supervisor_of
from service.jobs.runner import Jobs
from service.storage.database import StorageUnavailable
from service.storage.tables import DEFAULT_TENANT
from service.validation import ProblemError
from service.version import VERSION
from service.workers.supervisor import WorkerSupervisor

#: Longest time after which a caller is told to ask again [s].
_LONGEST_RETRY = 60

router = json_router("health", "")


class Health(Answer):
    """The state of the service."""

    status: str = Field(examples=["ok"], description="`ok`, or `ready` where work can be sent")
    version: str = Field(examples=["0.4.0"], description="of the service")


class Readiness(Health):
    """The state of the workers."""

    workers: int = Field(examples=[2], description="workers that can take a job")
    busy: int = Field(examples=[0], description="workers that have a job")
    waiting: int = Field(examples=[0], description="jobs that wait for a worker")


@router.get("/healthz", summary="Whether the process answers")
async def healthz() -> Health:
    """Answers for as long as the server runs, ready or not."""
    return Health(status="ok", version=VERSION)


@router.get("/readyz", summary="Whether work can be sent")
async def readyz(request: Request) -> Readiness:
    """Answers 200 once kernels are warm and workers are up, 503 before.

    Also 503 `STORAGE_UNAVAILABLE` while the database is locked, full or away.
    """
    supervisor = supervisor_of(request)
    if not supervisor.ready:
        raise _not_ready(supervisor)
    fault = store_of(request).database.fault
    if fault is not None:
        raise StorageUnavailable(fault)
    jobs: Jobs = request.app.state.jobs
    if not jobs.is_connected:
        raise StorageUnavailable("the queue of jobs can't be reached")
    return Readiness(
        status="ready",
        version=VERSION,
        workers=supervisor.alive,
        busy=supervisor.busy,
        waiting=supervisor.waiting,
    )


@router.get(
    "/metrics",
    summary="Counters for Prometheus",
    response_class=Response,
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}},
)
async def metrics(request: Request) -> Response:
    """Requests, workers, queues, jobs, plans and stages in Prometheus's text format.

    They are those of the whole service. A key of another tenant than `default`, which that of
    whoever runs the service is, is told of its own jobs only.
    """
    state = request.app.state
    tenant = caller_of(request.scope).tenant
    if tenant != DEFAULT_TENANT:
        own = await run_in_threadpool(state.store.jobs.counts, tenant)
        return Response(jobs_text(own), media_type=CONTENT_TYPE_PLAIN_0_0_4)
    jobs = await run_in_threadpool(state.store.jobs.counts)
    held: Jobs = state.jobs
    waiting = await held.waiting_messages()
    counted: Metrics = state.metrics
    return Response(counted.text(jobs, waiting), media_type=CONTENT_TYPE_PLAIN_0_0_4)


def _not_ready(supervisor: WorkerSupervisor) -> ProblemError:
    """Say what the workers wait for, and how long that may take."""
    if supervisor.unfit:
        return ProblemError(
            "NOT_READY",
            "the workers can't start",
            stage="start",
            hint="The log of the service says why.",
            retry_after=_LONGEST_RETRY,
        )
    hint = "Ask again after the time in Retry-After."
    progress = supervisor.progress
    if progress is None:
        what = "the workers are still warming up"
        return ProblemError("NOT_READY", what, stage="start", hint=hint, retry_after=1)
    detail = f"kernels are being compiled: {progress.done} of {progress.total}"
    seconds = 1
    if progress.remaining is not None:
        seconds = math.ceil(progress.remaining)
        detail += f", about {seconds} s left"
    return ProblemError(
        "NOT_READY",
        detail,
        stage="start",
        hint=f"{hint} This happens once: what is compiled is kept.",
        retry_after=max(1, min(_LONGEST_RETRY, seconds)),
        compiled=progress.done,
        kernels=progress.total,
        seconds_left=progress.remaining,
    )
