"""Exports of motions for robot controllers."""

from fastapi import APIRouter, Request, Response

from armwright_wire.motions.export import ExportAnswer, ExportRequest
from service.http import answers
from service.http.json_route import JsonRoute
from service.http.openapi import RESPONSES
from service.task_references import export as export_task

router = APIRouter(prefix="/v1", tags=["timing"], route_class=JsonRoute, responses=RESPONSES)


@router.post(
    "/export", summary="Write a motion for a robot controller", response_model=ExportAnswer
)
async def export(body: ExportRequest, request: Request) -> Response:
    """A motion as a ROS 2 message, a table or a program, with a proof of its own.

    Proved is the motion that the controller makes of the points in the file, by the interpolation
    that its manual names. The file says what is proved and what is not.
    """
    content = await request.body()
    result = await answers.answer(
        request,
        lambda robot, scene: export_task.job(robot, scene, content),
        body.robot,
        body.scene,
        timeout=body.timeout,
    )
    return Response(result, media_type="application/json")
