"""Reach of an arm: which poses it takes, and where its base should stand."""

from fastapi import APIRouter, Request, Response

from armwright_wire.robots.reach import ReachAnswer, ReachRequest
from service.http import answers
from service.http.json_route import JsonRoute
from service.http.openapi import RESPONSES
from service.task_references import reach as reach_task

_RESULT = {
    200: {
        "description": "Arrays with a number for each pose, a picture or a mesh",
        "model": ReachAnswer,
        "content": {"image/svg+xml": {}, "model/gltf-binary": {}},
    }
}
_MEDIA_TYPES = {
    "json": "application/json",
    "svg": "image/svg+xml",
    "glb": "model/gltf-binary",
}
router = APIRouter(
    prefix="/v1/robots/{name}", tags=["kinematics"], route_class=JsonRoute, responses=RESPONSES
)


@router.post(
    "/reach",
    summary="Reach of task poses",
    response_model=ReachAnswer,
    responses=_RESULT,  # type: ignore[arg-type]
)
async def reach(name: str, body: ReachRequest, request: Request) -> Response:
    """For each pose whether it is reached free of collision, by how many branches and how well.

    Poses are listed, or stand on a grid in a box. With candidates for the base they are answered
    best first: those that reach most poses, then those with the largest least clearance.
    """
    content = await request.body()
    result = await answers.answer(
        request,
        lambda robot, scene: reach_task.job(robot, scene, content),
        name,
        body.scene,
        timeout=body.timeout,
    )
    return Response(result, media_type=_MEDIA_TYPES[body.format])
