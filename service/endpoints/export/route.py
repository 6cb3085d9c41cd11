"""Exports of motions for robot controllers."""

from fastapi import Request, Response

from armwright_wire.motions.export import ExportAnswer, ExportRequest
from service.http import answers
from service.http.json_route import json_router
from service.task_references import export as export_task

router = json_router("timing")


@router.post(
    "/export", summary="Write a motion for a robot controller", response_model=ExportAnswer
)
async def export(body: ExportRequest, request: Request) -> Response:
    """A motion as a ROS 2 message, a table or a program, with a proof of its own.

    Proved is the motion that the controller makes of the points in the file, by the interpolation
    that its manual names. The file says what is proved and what is not.
    """
    return await answers.respond(request, export_task.job, body.robot, body)
