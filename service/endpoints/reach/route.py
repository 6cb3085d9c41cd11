"""Reach of an arm: which poses it takes, and where its base should stand."""

from fastapi import Request, Response

from armwright_wire.robots.reach import ReachAnswer, ReachRequest
from service.http import answers
from service.http.json_route import json_router
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
router = json_router("kinematics", "/v1/robots/{name}")


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
    return await answers.respond(request, reach_task.job, name, body, _MEDIA_TYPES[body.format])
