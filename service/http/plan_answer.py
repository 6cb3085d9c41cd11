"""Has a worker plan, and counts what came of it."""

from typing import Protocol

from fastapi import Request

from service.http.compute import GRACE
from service.http.errors import ProblemError
from service.metrics import Metrics
from service.schemas.scene import Scene
from service.settings import Settings
from service.storage import robot_repository
from service.storage.cache_key import Reference
from service.tasks.result import PlanOutcome
from service.workers.main import Job
from service.workers.process import Progress


class Asked(Protocol):
    """What has to be known of a request for a plan."""

    @property
    def robot(self) -> str:
        """Its name."""

    @property
    def scene(self) -> str | Scene | None:
        """As it is given."""

    @property
    def timeout(self) -> float | None:
        """As it is given [s]."""


async def planned(
    request: Request,
    body: Asked,
    content: bytes,
    scene: Reference | None = None,
    on_progress: Progress | None = None,
) -> bytes:
    """The answer to a request for a plan, JSON.

    Args:
        request: On whose behalf.
        body: What is asked.
        content: The same as JSON, for the worker.
        scene: In place of the one of the body.
        on_progress: Told of progress in place of the job that the request belongs to.

    Raises:
        ProblemError: There is no plan; as `catalog.answer`.
    """
    settings: Settings = request.app.state.settings
    metrics: Metrics = request.app.state.metrics
    timeout = settings.default_timeout if body.timeout is None else body.timeout

    def job(robot: Reference, stored: Reference | None) -> Job:
        return Job("service.tasks.plan:plan", (robot, scene or stored, content, timeout))

    try:
        found: PlanOutcome = await robot_repository.answer(
            request,
            job,
            body.robot,
            body.scene,
            timeout=timeout,
            patience=GRACE,
            on_progress=on_progress,
        )
    except ProblemError as problem:
        metrics.plan_failed(problem.code, problem.details.get("stages"))
        raise
    metrics.plan_succeeded(found.planner, found.stages)
    return found.content
