"""Collision checks of configurations."""

from fastapi import APIRouter, Request, Response

from service.http.body import JsonRoute
from service.http.openapi import RESPONSES
from service.schemas.check import CheckAnswer, CheckRequest
from service.storage import robot_repository
from service.workers.main import Job

router = APIRouter(prefix="/v1", tags=["checking"], route_class=JsonRoute, responses=RESPONSES)


@router.post("/check", summary="Check configurations", response_model=CheckAnswer)
async def check(body: CheckRequest, request: Request) -> Response:
    """Whether configurations are within limits and free, and how far from anything they are."""
    content = await request.body()
    result = await robot_repository.answer(
        request,
        lambda robot, scene: Job("service.tasks.check:check", (robot, scene, content)),
        body.robot,
        body.scene,
        timeout=body.timeout,
    )
    return Response(result, media_type="application/json")
