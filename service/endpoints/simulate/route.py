"""Closed-loop simulation of a motion under a controller."""

from fastapi import APIRouter, Request, Response

from armwright_wire.motions.simulation import SimulateAnswer, SimulateRequest
from service.http import answers
from service.http.json_route import JsonRoute
from service.http.openapi import RESPONSES
from service.task_references import simulate as simulate_task

router = APIRouter(prefix="/v1", tags=["tracking"], route_class=JsonRoute, responses=RESPONSES)


@router.post("/simulate", summary="Follow a motion", response_model=SimulateAnswer)
async def simulate(body: SimulateRequest, request: Request) -> Response:
    """Simulation of a controller that makes the robot follow a motion, for example a planned one.

    With a scene the answer says what the tracking error leaves of the clearance.
    """
    content = await request.body()
    result = await answers.answer(
        request,
        lambda robot, scene: simulate_task.job(robot, scene, content),
        body.robot,
        body.scene,
        timeout=body.timeout,
    )
    return Response(result, media_type="application/json")
