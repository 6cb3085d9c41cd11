"""Planning of motions, and proofs of anybody's."""

import json
from typing import cast

from fastapi import Request, Response
from starlette.concurrency import run_in_threadpool

from armwright_wire.motions.certificate import CertificateAnswer
from armwright_wire.plans.plan import PlanAnswer, PlanRequest, ValidateRequest
from service.http import answers
from service.http.json_route import json_router
from service.http.metrics import Metrics
from service.http.state import kept_plan
from service.task_references import plan as plan_task
from service.task_references import validate as validate_task
from service.validation import ProblemError

router = json_router("planning")


@router.post("/plan", summary="Plan a certified motion", response_model=PlanAnswer)
async def plan(body: PlanRequest, request: Request) -> Response:
    """A timed motion from the start to a goal, proved free and inside all limits at every instant.

    Where none is found in time, or none can be proved, the answer is a problem that says why.
    """
    name, left = body.start.plan, None
    if name is not None:
        _, kept = await kept_plan(request, name)
        left = await run_in_threadpool(_motion, name, kept.answer)
    content, metrics = await request.body(), cast(Metrics, request.app.state.metrics)
    try:
        outcome = await answers.answer(
            request,
            lambda robot, scene: plan_task.job(robot, scene, content, left),
            body.robot,
            body.scene,
            timeout=body.timeout,
        )
    except ProblemError as problem:
        metrics.count_failure(problem.code, problem.details.get("stages"))
        raise
    metrics.count_plan(outcome.planner, outcome.stages)
    return answers.json_answer(outcome.content)


@router.post("/validate", summary="Prove a motion", response_model=CertificateAnswer)
async def validate(body: ValidateRequest, request: Request) -> Response:
    """The certificate of anybody's motion, or its first violation with the time."""
    return await answers.respond(request, validate_task.job, body.robot, body)


def _motion(name: str, content: bytes) -> bytes:
    """The trajectory of the answer of a kept plan, JSON.

    Raises:
        ProblemError: VALIDATION_ERROR, the plan has no motion.
    """
    answer = json.loads(content)
    motion = answer.get("trajectory") if isinstance(answer, dict) else None
    if not isinstance(motion, dict) or "segments" not in motion:
        raise ProblemError(
            "VALIDATION_ERROR",
            f"start.plan: plan {name!r} has no trajectory that could be left",
            stage="request",
            hint="Name a kept plan of POST /v1/plan that succeeded.",
        )
    return json.dumps({field: motion[field] for field in ("joint_names", "segments")}).encode()
