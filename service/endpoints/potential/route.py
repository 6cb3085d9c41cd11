"""The artificial potential of a robot on its way to a goal."""

from fastapi import Request, Response

from armwright_wire.robots.potential import PotentialAnswer, PotentialRequest
from service.http import answers
from service.http.json_route import json_router
from service.task_references import potential as potential_task

router = json_router("planning", "/v1/robots/{name}")


@router.post("/potential", summary="The artificial potential", response_model=PotentialAnswer)
async def potential(name: str, body: PotentialRequest, request: Request) -> Response:
    """U(q), its slope, and the forces on the control points that make it.

    Control points are the origins O_i of the robot's Denavit-Hartenberg frames, the last one that
    of the tip. Each is pulled to where it is at the goal, with a force that no longer grows beyond
    `attractive_cap`, and pushed away by every obstacle nearer than `influence_distance`, along the
    line to its orthogonal projection. Inside an obstacle it is pushed along the shortest way out;
    an obstacle of several pieces (a mesh, a cloud) pushes once, from the nearest of them.
    """
    return await answers.respond(request, potential_task.job, name, body)
