"""Tasks called in this process, on built-in robots, with answers as their schemas have them."""

import json
from typing import Any

from pydantic import BaseModel

from service.storage.caches.cache_key import builtin_reference
from service.workers.result import PlanOutcome, TaskProblem

PANDA = builtin_reference("panda")
PLANAR = builtin_reference("planar_rr")


def answer_of(task: Any, robot: Any, body: dict[str, Any], schema: type[BaseModel]) -> Any:
    """The answer of a task to a request, which its schema takes."""
    result = task(robot, None, json.dumps(body).encode())
    content = result.content if isinstance(result, PlanOutcome) else result
    assert isinstance(content, bytes), result
    answer = json.loads(content)
    schema.model_validate(answer)
    return answer


def problem_of(task: Any, robot: Any, body: dict[str, Any]) -> TaskProblem:
    """The problem that a task answers a request with."""
    result = task(robot, None, json.dumps(body).encode())
    assert isinstance(result, TaskProblem), result
    return result
