"""Supervisors with workers for tests, and their jobs."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from planning.values.deadline import Deadline
from service.workers.fork.launch import Recipe
from service.workers.process import DEFAULT_LIMITS, WorkerLimits
from service.workers.supervisor import WorkerSupervisor
from service.workers.task import Job

MODULE = "tests.service.chores"


def chore(name: str, *args: Any, seconds: float = 20.0, **kwargs: Any) -> Job[Any]:
    job: Job[Any] = Job(f"tests.service.chores:{name}", args, kwargs)
    return job.with_deadline(Deadline.after(seconds))


@asynccontextmanager
async def supervisor(
    count: int = 2,
    queue_limit: int = 1000,
    warm: str = "no_warming",
    enrich: str | None = None,
    spares: int = 0,
    limits: WorkerLimits = DEFAULT_LIMITS,
) -> AsyncIterator[WorkerSupervisor]:
    step = None if enrich is None else f"{MODULE}:{enrich}"
    recipe = Recipe((MODULE,), f"{MODULE}:{warm}", step)
    workers = WorkerSupervisor(count, queue_limit, recipe=recipe, spares=spares, limits=limits)
    await workers.start()
    try:
        yield workers
    finally:
        await workers.stop()


def supervised(count: int = 2, **options: Any) -> pytest.MarkDecorator:
    """A mark of tests whose fixture `workers` is another supervisor than one of one worker.

    Args:
        count: Number of its workers.
        options: Of `supervisor`.
    """
    chosen = {"count": count, **options}
    return pytest.mark.parametrize("workers", [chosen], ids=[""], indirect=True)


async def ready(workers: WorkerSupervisor) -> None:
    async with asyncio.timeout(60.0):
        while not workers.ready:
            await asyncio.sleep(0.005)


async def working(workers: WorkerSupervisor, count: int) -> None:
    async with asyncio.timeout(30.0):
        while workers.busy != count:
            await asyncio.sleep(0.005)
