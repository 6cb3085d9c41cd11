"""Has workers look through large bodies, so that the event loop is free meanwhile.

Parsing 30 MB of JSON and validating it takes seconds in which nobody else would be answered, in a
thread as well, since it never lets go of the interpreter.
"""

import time

from fastapi import Request
from pydantic import BaseModel

from service.http.errors import from_fields
from service.settings import Settings
from service.tasks.result import TaskProblem
from service.workers.main import Job
from service.workers.supervisor import WorkerSupervisor

#: Bodies up to this are parsed and validated within milliseconds [byte].
INLINE_BYTES = 256 * 1024


async def outlined(request: Request, model: type[BaseModel], content: bytes) -> BaseModel:
    """A body validated by a worker, its parts empty.

    Raises:
        ProblemError: VALIDATION_ERROR; as `WorkerSupervisor.submit`.
    """
    supervisor: WorkerSupervisor = request.app.state.supervisor
    settings: Settings = request.app.state.settings
    path = f"{model.__module__}:{model.__qualname__}"
    job = Job("service.tasks.large_body:outline", (path, content))
    deadline = time.monotonic() + settings.max_timeout
    found: BaseModel | TaskProblem = await supervisor.submit(job, deadline)
    if isinstance(found, TaskProblem):
        raise from_fields(found.code, found.message, found.hint, found.details)
    return found
