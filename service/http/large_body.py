"""Validation of large bodies by workers, so that the event loop stays free.

Parsing 30 MB of JSON and validating it takes seconds in which nobody else would be answered, in a
thread as well, since it never lets go of the interpreter.
"""

from fastapi import Request
from pydantic import BaseModel

from service.http.state import settings_of, supervisor_of
from service.problem import from_fields
from service.schemas.strict_json import check_field_count
from service.task_references import outline
from service.tasks.result import TaskProblem

#: Bodies up to this are parsed and validated within milliseconds [byte].
INLINE_BYTES = 32 * 1024


async def validated_by_worker(
    request: Request, model: type[BaseModel], content: bytes
) -> BaseModel:
    """An instance of a body's model, validated by a worker, with empty parts.

    Raises:
        ProblemError: VALIDATION_ERROR; as `check_field_count` and `WorkerSupervisor.submit`.
    """
    check_field_count(content)
    job = outline.job(f"{model.__module__}:{model.__qualname__}", content)
    result = await supervisor_of(request).submit(job.with_timeout(settings_of(request).max_timeout))
    if isinstance(result, TaskProblem):
        raise from_fields(result.code, result.message, result.hint, result.details)
    return result
