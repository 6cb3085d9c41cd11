"""Tasks of several stages, planned as one."""

from fastapi import Request, Response

from armwright_wire.plans.task import TaskAnswer, TaskRequest
from service.http import answers
from service.http.json_route import json_router
from service.task_references import plan_sequence

router = json_router("planning")


@router.post("/tasks", summary="Plan a task of several stages", response_model=TaskAnswer)
async def plan_task(body: TaskRequest, request: Request) -> Response:
    """The motions of all stages, each proved with what is held in it; they join at rest.

    Grasps, configurations and places are chosen together; what was tried is told with the reasons.
    Where no combination can be done, or time is up, the answer is a problem that says where.
    """
    return await answers.respond(request, plan_sequence.job, body.robot, body)
