"""Conversion and composition of poses."""

from fastapi import Request, Response

from armwright_wire.pose import ConvertPoseAnswer, ConvertPoseRequest
from service.http.compute import compute
from service.http.json_route import json_router
from service.task_references import convert_pose as convert_pose_task

router = json_router("kinematics", "/v1/poses")


@router.post("/convert", summary="Convert and compose poses", response_model=ConvertPoseAnswer)
async def convert_pose(body: ConvertPoseRequest, request: Request) -> Response:  # noqa: ARG001
    """A pose, or motions carried out in turn about current or fixed axes, in every form.

    Both branches of the angles are answered. Where an angle is not determined, `singular` says
    which combination is, and the choice made for the rest.
    """
    content = await request.body()
    result = await compute(request, convert_pose_task.job(content))
    return Response(result, media_type="application/json")
