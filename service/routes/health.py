"""Whether the process lives, and whether it can be given work."""

from fastapi import APIRouter, Request
from pydantic import Field

from service.body import JsonRoute
from service.errors import ProblemError
from service.openapi import RESPONSES
from service.schemas.base import Answer
from service.version import VERSION
from service.workers import WorkerSupervisor

router = APIRouter(tags=["health"], route_class=JsonRoute, responses=RESPONSES)


class Health(Answer):
    """The state of the service."""

    status: str = Field(examples=["ok"])
    version: str = Field(examples=["0.1.0"])


class Readiness(Health):
    """The state of the workers."""

    workers: int = Field(examples=[2], description="worker processes that live")
    busy: int = Field(examples=[0], description="workers that have a job")
    waiting: int = Field(examples=[0], description="jobs that wait for a worker")


@router.get("/healthz", summary="Whether the process answers")
async def healthz() -> Health:
    """Answers for as long as the server runs, ready or not."""
    return Health(status="ok", version=VERSION)


@router.get("/readyz", summary="Whether work can be sent")
async def readyz(request: Request) -> Readiness:
    """Answers 200 once kernels are warm and workers are up, 503 before."""
    supervisor: WorkerSupervisor = request.app.state.supervisor
    if not supervisor.ready:
        raise ProblemError(
            "NOT_READY",
            "the workers are still warming up",
            stage="start",
            hint="Ask again after the time in Retry-After.",
            retry_after=1,
        )
    return Readiness(
        status="ready",
        version=VERSION,
        workers=len(supervisor.pids),
        busy=supervisor.busy,
        waiting=supervisor.waiting,
    )
