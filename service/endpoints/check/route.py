"""Collision checks of configurations."""

from fastapi import APIRouter, Request, Response

from armwright_wire.scenes.check import CheckAnswer, CheckRequest
from service.http import answers
from service.http.json_route import JsonRoute
from service.http.openapi import RESPONSES
from service.task_references import check as check_task

router = APIRouter(prefix="/v1", tags=["checking"], route_class=JsonRoute, responses=RESPONSES)


@router.post("/check", summary="Check configurations", response_model=CheckAnswer)
async def check(body: CheckRequest, request: Request) -> Response:
    """Whether configurations are within limits and free, and how far from anything they are."""
    content = await request.body()
    result = await answers.answer(
        request,
        lambda robot, scene: check_task.job(robot, scene, content),
        body.robot,
        body.scene,
        timeout=body.timeout,
    )
    return Response(result, media_type="application/json")
