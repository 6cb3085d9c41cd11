"""Plans computed in workers, and counted."""

from typing import Protocol

from fastapi import Request

from armwright_wire.scene import Scene
from service.http import answers
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
        body: The problem.
        content: The problem as JSON, for the worker.

    Raises:
        ProblemError: There is no plan; as `answers.answer`.
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
        metrics.count_failure(problem.code, problem.details.get("stages"))
        raise
    metrics.count_plan(outcome.planner, outcome.stages)
    return outcome.content
