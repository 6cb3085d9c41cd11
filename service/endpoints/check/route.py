"""Collision checks of configurations."""

from fastapi import Request, Response

from armwright_wire.scenes.check import CheckAnswer, CheckRequest
from service.http import answers
from service.http.json_route import json_router
from service.task_references import check as check_task

router = json_router("checking")


@router.post("/check", summary="Check configurations", response_model=CheckAnswer)
async def check(body: CheckRequest, request: Request) -> Response:
    """Whether configurations are within limits and free, and how far from anything they are."""
    return await answers.respond(request, check_task.job, body.robot, body)
