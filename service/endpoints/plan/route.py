"""Planning of motions, and proofs of anybody's."""

from fastapi import Request, Response

from armwright_wire.motions.certificate import CertificateAnswer
from armwright_wire.plans.plan import PlanAnswer, PlanRequest, ValidateRequest
from service.http import answers
from service.http.answers import plan_answer
from service.http.json_route import json_router
from service.task_references import validate as validate_task

router = json_router("planning")


@router.post("/plan", summary="Plan a certified motion", response_model=PlanAnswer)
async def plan(body: PlanRequest, request: Request) -> Response:
    """A timed motion from the start to a goal, proved free and inside all limits at every instant.

    Where none is found in time, or none can be proved, the answer is a problem that says why.
    """
    content = await plan_answer(request, body, await request.body())
    return Response(content, media_type="application/json")


@router.post("/validate", summary="Prove a motion", response_model=CertificateAnswer)
async def validate(body: ValidateRequest, request: Request) -> Response:
    """The certificate of anybody's motion, or its first violation with the time."""
    return await answers.respond(request, validate_task.job, body.robot, body)
