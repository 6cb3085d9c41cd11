"""All jobs of a service in one event loop: an application of a few lines stands in for ours."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from service.http.state import JOB_CONTEXT, JobContext
from service.jobs.runner import Jobs
from service.settings import Settings
from service.storage.store import Store
from service.storage.stores.job_store import JobAnswer, JobRecord
from tests.service.jobs.stored import opened


class App:
    """Answers when it is told to, and notes what reaches it."""

    def __init__(self) -> None:
        self.contexts: list[JobContext] = []
        self.bodies: list[bytes] = []
        self.open = asyncio.Event()
        self.status, self.location, self.body = 200, "", b'{"done": true}'
        self.error: Exception | None = None
        self.cancelled = 0

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        context: JobContext = scope[JOB_CONTEXT]
        self.contexts.append(context)
        self.bodies.append((await receive())["body"])
        context.on_start()
        try:
            await self.open.wait()
        except asyncio.CancelledError:
            self.cancelled += 1
            raise
        if self.error is not None:
            raise self.error
        headers = [(b"content-type", b"application/json")]
        headers += [(b"location", self.location.encode())] if self.location else []
        await send({"type": "http.response.start", "status": self.status, "headers": headers})
        await send({"type": "http.response.body", "body": self.body})


Scenario = Callable[[Jobs, App, Store], Awaitable[None]]


def run(folder: Path, scenario: Scenario, **settings: Any) -> None:
    """Carry out a scenario with all jobs of a service, which ends afterwards."""

    async def whole() -> None:
        app = App()
        with opened(folder) as store:
            options: dict[str, Any] = {"workers": 2, "keep_alive": 0.05, "data_dir": folder}
            jobs = Jobs(app, store, Settings(**(options | settings)))
            await jobs.start()
            try:
                await asyncio.wait_for(scenario(jobs, app, store), 20.0)
            finally:
                await jobs.stop()

    asyncio.run(whole())


async def until(condition: Callable[[], bool]) -> None:
    """Wait until something is so."""
    while not condition():
        await asyncio.sleep(0.002)


async def ended(jobs: Jobs, job: str) -> tuple[JobRecord, JobAnswer | None]:
    while True:
        found = await jobs.get(job)
        if found[0].ended is not None:
            return found
        await asyncio.sleep(0.002)
