"""Agents and a server on one PostgreSQL database in one event loop, with a stand-in for ours."""

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from service.endpoints.batch import task
from service.http.state import JOB_CONTEXT
from service.jobs.execution import BATCH_PATH
from service.jobs.runner import AgentJobs
from service.settings import Settings
from service.storage.store import Store, open_store
from service.workers.load import Durations
from service.workers.process import Background
from service.workers.task import Job
from tests.service.jobs.loop import App


class BatchApp(App):
    """Answers a batch with the seeds of its problems, and notes how many it had."""

    def __init__(self) -> None:
        super().__init__()
        self.open.set()
        self.sizes: list[int] = []

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        if scope["path"] == BATCH_PATH:
            content = (await receive())["body"]
            await asyncio.sleep(0.05)  # the other machine takes a chunk meanwhile
            first = scope[JOB_CONTEXT].first
            problems = json.loads(content)["problems"]
            seeds = [[first + n, problem["seed"]] for n, problem in enumerate(problems)]
            counts = {"succeeded": len(problems) - 1, "failed": 1}
            text = json.dumps({"results": seeds} | counts, separators=(",", ":"))
            self.body = text.encode()
            self.sizes.append(len(problems))

            async def again() -> Any:
                return {"body": content}

            await super().__call__(scope, again, send)
        else:
            await super().__call__(scope, receive, send)


class Workers:
    """Runs the task that cuts batches here, in place of worker processes."""

    def __init__(self, mean: float) -> None:
        self.durations, self.count = Durations(), 1
        self.durations.note("service.endpoints.plan.task:plan", mean)

    async def submit(self, job: Job[Any], _progress: Any, background: Background) -> Any:
        background.on_start()
        assert job.task == task.cut.name
        return task.cut.function(*job.args)


class Machine:
    """A server or an agent: its store, its jobs, and the application that answers them."""

    def __init__(self, url: str, folder: Path, *, is_agent: bool, **settings: Any) -> None:
        self.app = BatchApp()
        self.store: Store = open_store(url)
        options: dict[str, Any] = {"workers": 1, "keep_alive": 0.05, "data_dir": folder}
        chosen = Settings(**(options | settings), database_url=url, jobs="agents")
        workers: Any = Workers(mean=1.0)
        self.jobs = AgentJobs(self.app, self.store, chosen, workers, is_agent=is_agent)

    async def stop(self) -> None:
        await self.jobs.stop()
        self.store.close()

    def freeze(self) -> None:
        """Fall silent, to the database and to the queue, take no messages; the work goes on."""
        for chore in list(self.jobs._chores):
            chore.cancel()
        engine = self.jobs._engine
        assert engine is not None
        assert engine._worker is not None

        async def no_more(*_args: Any, **_options: Any) -> None:
            return None

        manager = engine._worker.app.job_manager
        manager.update_heartbeat = no_more  # type: ignore[method-assign]
        manager.fetch_job = no_more  # type: ignore[method-assign]


Scenario = Callable[[AgentJobs, Machine, Machine], Awaitable[None]]


def run(url: str, folder: Path, scenario: Scenario, **settings: Any) -> None:
    """Carry out a scenario with a server that leaves jobs to two agents."""

    async def whole() -> None:
        server = Machine(url, folder, is_agent=False, **settings)
        agents = [Machine(url, folder, is_agent=True, **settings) for _ in range(2)]
        for machine in (server, *agents):
            await machine.jobs.start()
        try:
            await asyncio.wait_for(scenario(server.jobs, *agents), 30.0)
        finally:
            await asyncio.gather(*(machine.stop() for machine in (server, *agents)))

    asyncio.run(whole())
