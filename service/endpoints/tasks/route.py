"""Tasks of several stages, planned as one."""

from fastapi import APIRouter, Request, Response

from armwright_wire.plans.task import TaskAnswer, TaskRequest
from service.http import answers
from service.http.json_route import JsonRoute
from service.http.openapi import RESPONSES
from service.task_references import plan_sequence

router = APIRouter(prefix="/v1", tags=["planning"], route_class=JsonRoute, responses=RESPONSES)


@router.post("/tasks", summary="Plan a task of several stages", response_model=TaskAnswer)
async def plan_task(body: TaskRequest, request: Request) -> Response:
    """The motions of all stages, each proved with what is held in it; they join at rest.

    Grasps, configurations and places are chosen together; what was tried is told with the reasons.
    Where no combination can be done, or time is up, the answer is a problem that says where.
    """
    content = await request.body()
    result = await answers.answer(
        request,
        lambda robot, scene: plan_sequence.job(robot, scene, content),
        body.robot,
        body.scene,
        timeout=body.timeout,
    )
    return Response(result, media_type="application/json")
