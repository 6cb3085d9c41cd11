"""Plans computed in workers, and counted."""

import asyncio
from typing import Protocol

from fastapi import Request

from armwright_wire.scene import Scene
from service.http import answers
from service.http.glance import Glance
from service.http.metrics import Metrics
from service.problem import ProblemError
from service.task_references import plan


class PlanProblem(Protocol):
    """The fields of a request for a plan that the server itself reads."""

    @property
    def robot(self) -> str:
        """The name of the robot."""

    @property
    def scene(self) -> str | Scene | None:
        """The name of a stored scene, an inline scene, or none."""

    @property
    def timeout(self) -> float | None:
        """For all stages together, if one is named [s]."""


async def plan_answer(
    request: Request,
    body: PlanProblem,
    content: bytes,
) -> bytes:
    """The answer to a request for a plan, JSON.

    Args:
        request: On whose behalf.
        body: The problem, or a glance at it.
        content: The problem as JSON, for the worker.

    Raises:
        ProblemError: There is no plan; as `answers.answer`.
        RequestValidationError: As `Glance.check`.
    """
    metrics: Metrics = request.app.state.metrics
    try:
        outcome = await answers.answer(
            request,
            lambda robot, scene: plan.job(robot, scene, content),
            body.robot,
            body.scene,
            timeout=body.timeout,
        )
    except ProblemError as problem:
        if isinstance(body, Glance):
            body.check()
        metrics.count_failure(problem.code, problem.details.get("stages"))
        raise
    # Behind the answer: whoever waits for it need not wait for this.
    asyncio.get_running_loop().call_soon(metrics.count_plan, outcome.planner, outcome.stages)
    return outcome.content
