"""Closed-loop simulation of a motion under a controller."""

from fastapi import Request, Response

from armwright_wire.motions.simulation import SimulateAnswer, SimulateRequest
from service.http import answers
from service.http.json_route import json_router
from service.task_references import simulate as simulate_task

router = json_router("tracking")


@router.post("/simulate", summary="Follow a motion", response_model=SimulateAnswer)
async def simulate(body: SimulateRequest, request: Request) -> Response:
    """Simulation of a controller that makes the robot follow a motion, for example a planned one.

    With a scene the answer says what the tracking error leaves of the clearance.
    """
    return await answers.respond(request, simulate_task.job, body.robot, body)
