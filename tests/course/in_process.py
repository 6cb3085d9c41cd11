"""The service with its tasks in this process: the real routes and schemas, no worker processes."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from starlette.concurrency import run_in_threadpool

from kinematics.errors import ArmwrightError
from service.app import create_app
from service.settings import Settings
from service.task_references import MODULES
from service.validation import from_fields
from service.workers import current
from service.workers.load import InFlight
from service.workers.task import Job, load_tasks, registered_task
from tests.service.server import serving


class LocalWorkers:
    """A supervisor that runs every job in a thread of this process, one at a time."""

    ready = True
    unfit = False
    is_ready_for_work = is_free = True
    progress = None
    waiting = background_waiting = busy = spare = 0
    count = alive = started_workers = 1

    def __init__(self, *_arguments: Any, **_options: Any) -> None:
        self.in_flight = InFlight()
        for module in MODULES:
            load_tasks(module)

    async def start(self) -> None:
        """Nothing has to start."""

    async def stop(self) -> None:
        """Nothing has to end."""

    async def submit(
        self,
        job: Job[Any],
        on_progress: Any = None,
        background: Any = None,
        *,
        brief: bool = False,
        client: str = "",
    ) -> Any:
        """The result of a job.

        Raises:
            ProblemError: The fault of the caller that the task found.
        """
        return await run_in_threadpool(_run, job)


def _run(job: Job[Any]) -> Any:
    current.begin(job.deadline, None)
    try:
        return registered_task(job.task)(*job.args, **job.kwargs)
    except ArmwrightError as error:
        raise from_fields(error.code, error.message, error.hint, dict(error.details)) from error
    finally:
        current.end()


@contextmanager
def service_in_process(folder: Path) -> Iterator[httpx.Client]:
    """The application with local workers; gives a client of it.

    Args:
        folder: Where it stores robots and scenes.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("service.app.WorkerSupervisor", LocalWorkers)
        app = create_app(Settings(data_dir=folder, workers=1))
        with serving(app) as client:
            # Its workers are there now; other tests of this process want real ones.
            patch.undo()
            yield client
