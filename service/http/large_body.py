"""Validation of large bodies by workers, so that the event loop stays free.

Parsing 30 MB of JSON and validating it takes seconds in which nobody else would be answered, in a
thread as well, since it never lets go of the interpreter.
"""

from fastapi import Request
from pydantic import BaseModel

from service.access.caller import client_of
from service.http.admission import named_timeout
from service.http.compute import deadline_of
from service.http.job_context import job_context
from service.http.state import settings_of, supervisor_of
from service.problem import from_fields
from service.settings import Settings
from service.task_references import outline
from service.tasks.result import TaskProblem
from service.validation import check_field_count

#: Bodies up to this are parsed and validated within milliseconds [byte].
INLINE_BYTES = 32 * 1024


async def validated_by_worker(
    request: Request, model: type[BaseModel], content: bytes
) -> BaseModel:
    """An instance of a body's model, validated by a worker, with parts cut short.

    Raises:
        ProblemError: VALIDATION_ERROR; as `check_field_count` and `WorkerSupervisor.submit`.
    """
    check_field_count(content)
    settings = settings_of(request)
    seconds = settings.max_timeout
    if job_context(request) is None:  # a job has its time once it is taken up
        seconds = _time_to_validate(model, content, settings)
    job = outline.job(f"{model.__module__}:{model.__qualname__}", content)
    result = await supervisor_of(request).submit(
        job.with_deadline(deadline_of(request, seconds)), client=client_of(request.scope)
    )
    if isinstance(result, TaskProblem):
        raise from_fields(result.code, result.message, result.hint, result.details)
    return result


def _time_to_validate(model: type[BaseModel], content: bytes, settings: Settings) -> float:
    """Time that a body may take to be validated: that of its request, if it may name one [s]."""
    if "timeout" not in model.model_fields:
        return settings.max_timeout
    return named_timeout(content, settings)
