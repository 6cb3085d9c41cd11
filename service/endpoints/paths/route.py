"""Paths of fewer waypoints."""

from fastapi import Request, Response

from armwright_wire.motions.paths import SimplifyAnswer, SimplifyRequest
from service.http import answers
from service.http.json_route import json_router
from service.task_references import simplify as simplify_task

router = json_router("timing")


@router.post(
    "/paths/simplify",
    summary="Tell a path by the fewest waypoints within a tolerance",
    response_model=SimplifyAnswer,
)
async def simplify(body: SimplifyRequest, request: Request) -> Response:
    """Waypoints of a path whose straight lines follow it within a tolerance in every joint.

    With a robot the lines are proved against its limits of position and the scene; where they are
    not free, nearer ones are tried.
    """
    if body.robot is not None:
        return await answers.respond(request, simplify_task.job, body.robot, body)
    content = await request.body()
    result = await answers.answer_with(
        request, lambda robot: simplify_task.job(robot, None, content), None, timeout=body.timeout
    )
    return Response(result, media_type="application/json")
