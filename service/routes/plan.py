"""Planning of motions, and proofs of anybody's."""

from fastapi import APIRouter, Request, Response

from service.http.body import JsonRoute
from service.http.compute import GRACE
from service.http.openapi import RESPONSES
from service.http.plan_answer import planned
from service.schemas.plan import CertificateAnswer, PlanAnswer, PlanRequest, ValidateRequest
from service.settings import Settings
from service.storage import robot_repository
from service.workers.main import Job

router = APIRouter(prefix="/v1", tags=["planning"], route_class=JsonRoute, responses=RESPONSES)


@router.post("/plan", summary="Plan a certified motion", response_model=PlanAnswer)
async def plan(body: PlanRequest, request: Request) -> Response:
    """A timed motion from the start to a goal, proved free and inside all limits at every instant.

    Where none is found in time, or none can be proved, the answer is a problem that says why.
    """
    content = await planned(request, body, await request.body())
    return Response(content, media_type="application/json")


@router.post("/validate", summary="Prove a motion", response_model=CertificateAnswer)
async def validate(body: ValidateRequest, request: Request) -> Response:
    """The certificate of anybody's motion, or its first violation with the time."""
    content = await request.body()
    settings: Settings = request.app.state.settings
    timeout = settings.default_timeout if body.timeout is None else body.timeout
    result = await robot_repository.answer(
        request,
        lambda robot, scene: Job("service.tasks.plan:validate", (robot, scene, content, timeout)),
        body.robot,
        body.scene,
        timeout=timeout,
        patience=GRACE,
    )
    return Response(result, media_type="application/json")
