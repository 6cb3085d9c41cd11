"""Closed-loop simulation of a motion under a controller."""

from fastapi import APIRouter, Request, Response

from service.http.body import JsonRoute
from service.http.compute import GRACE
from service.http.openapi import RESPONSES
from service.schemas.simulation import SimulateAnswer, SimulateRequest
from service.settings import Settings
from service.storage import robot_repository
from service.workers.main import Job

router = APIRouter(prefix="/v1", tags=["tracking"], route_class=JsonRoute, responses=RESPONSES)


@router.post("/simulate", summary="Follow a motion", response_model=SimulateAnswer)
async def simulate(body: SimulateRequest, request: Request) -> Response:
    """How well a controller makes the robot follow a motion, for example one that was planned.

    With a scene the answer says what the tracking error leaves of the clearance.
    """
    content = await request.body()
    settings: Settings = request.app.state.settings
    timeout = settings.default_timeout if body.timeout is None else body.timeout
    result = await robot_repository.answer(
        request,
        lambda robot, scene: Job(
            "service.tasks.simulate:simulate", (robot, scene, content, timeout)
        ),
        body.robot,
        body.scene,
        timeout=timeout,
        patience=GRACE,
    )
    return Response(result, media_type="application/json")
