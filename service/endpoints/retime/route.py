"""Timing of given paths, and motions in other people's shapes."""

from fastapi import Request, Response

from armwright_wire.motions.paths import SimplifyAnswer, SimplifyRequest
from armwright_wire.motions.retime import (
    ConvertRequest,
    JointTrajectoryAnswer,
    RetimeAnswer,
    RetimeRequest,
)
from service.http import answers
from service.http.compute import compute
from service.http.json_route import json_router
from service.task_references import convert as convert_task
from service.task_references import retime as retime_task
from service.task_references import simplify as simplify_task

router = json_router("timing")


@router.post(
    "/retime", summary="Time a path, or the motion between two states", response_model=RetimeAnswer
)
async def retime(body: RetimeRequest, request: Request) -> Response:
    """A path, or two states, as a timed motion within a robot's limits or those given.

    The limits are certified. Of collisions nothing is known, which the certificate says.
    """
    content = await request.body()
    result = await answers.answer_with(
        request,
        lambda robot: retime_task.job(robot, content),
        body.robot,
        timeout=body.timeout,
    )
    return Response(result, media_type="application/json")


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


@router.post(
    "/convert",
    summary="Tell a motion in another shape",
    response_model=JointTrajectoryAnswer,
)
async def convert(body: ConvertRequest, request: Request) -> Response:
    """A motion as trajectory_msgs/JointTrajectory of ROS in JSON, or as a table in CSV."""
    content = await request.body()
    result = await compute(request, convert_task.job(content))
    media_type = "text/csv" if body.format == "csv" else "application/json"
    return Response(result, media_type=media_type)
