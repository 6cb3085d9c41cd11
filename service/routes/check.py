"""Collision checks of configurations."""

from fastapi import APIRouter, Request, Response

from service import catalog
from service.body import JsonRoute
from service.openapi import RESPONSES
from service.schemas.check import CheckAnswer, CheckRequest
from service.worker_main import Job

router = APIRouter(prefix="/v1", tags=["checking"], route_class=JsonRoute, responses=RESPONSES)


@router.post("/check", summary="Check configurations", response_model=CheckAnswer)
async def check(body: CheckRequest, request: Request) -> Response:
    """Whether configurations are within limits and free, and how far from anything they are."""
    content = await request.body()
    result = await catalog.answer(
        request,
        lambda robot, scene: Job("service.check_tasks:check", (robot, scene, content)),
        body.robot,
        body.scene,
        timeout=body.timeout,
    )
    return Response(result, media_type="application/json")
