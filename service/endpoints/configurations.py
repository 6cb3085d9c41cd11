"""Requests about configurations of a robot: few are answered at once, many wait their turn."""

from collections.abc import Sequence

from fastapi import Request, Response

from service.http import answers
from service.workers.result import ChainTask


def count(joints: Sequence[float] | Sequence[Sequence[float]]) -> int:
    """The number of configurations in a field ``joints``."""
    return len(joints) if isinstance(joints[0], list) else 1


async def respond(request: Request, robot: str, task: ChainTask, *, is_brief: bool) -> Response:
    """Response with the result of a task about the body of a request and a robot.

    Args:
        request: Request on whose behalf.
        robot: Name of the robot.
        task: Task that the body is for.
        is_brief: Whether the task takes a millisecond: it is done then whatever else is being
            computed.

    Raises:
        ProblemError: As `answers.answer` and `answers.answer_at_once`.
    """
    content = await request.body()
    if is_brief:
        return json_answer(
            await answers.answer_at_once(request, lambda found: task.job(found, content), robot)
        )
    return json_answer(
        await answers.answer(request, lambda found, _: task.job(found, content), robot)
    )


def json_answer(content: bytes) -> Response:
    """An answer that is JSON already."""
    return Response(content, media_type="application/json")
