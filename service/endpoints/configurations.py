"""Requests about configurations of a robot: few are answered at once, many wait their turn."""

from collections.abc import Sequence

from fastapi import Request, Response

from service.http import answers
from service.workers.result import ChainTask


def count(joints: Sequence[float] | Sequence[Sequence[float]]) -> int:
    """The number of configurations in a field ``joints``."""
    return len(joints) if isinstance(joints[0], list) else 1


async def in_worker(request: Request, robot: str, task: ChainTask) -> Response:
    """The answer of a task to the body of a request about a robot.

    Raises:
        ProblemError: As `answers.answer`.
    """
    content = await request.body()
    result = await answers.answer(request, lambda reference, _: task.job(reference, content), robot)
    return json_answer(result)


async def at_once(request: Request, robot: str, task: ChainTask) -> Response:
    """The answer of a task that takes a millisecond, whatever else is being computed.

    Raises:
        ProblemError: As `answers.answer_at_once`.
    """
    content = await request.body()
    result = await answers.answer_at_once(
        request, lambda reference: task.job(reference, content), robot
    )
    return json_answer(result)


def json_answer(content: bytes) -> Response:
    """An answer that is JSON already."""
    return Response(content, media_type="application/json")
