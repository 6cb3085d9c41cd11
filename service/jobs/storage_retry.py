"""Calls of the storage that wait until it can be used, and the purge of old answers in it."""

import asyncio
import contextlib
import time
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from starlette.concurrency import run_in_threadpool

from service.settings import Settings
from service.storage.database import StorageUnavailable
from service.storage.stores.job_store import JobStore

#: How often storage that can't be used is tried again [s].
STORAGE_RETRY = 0.5

P = ParamSpec("P")
R = TypeVar("R")


async def when_possible(call: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
    """The result of a call of the storage, as soon as the storage can be used."""
    while True:
        try:
            return await run_in_threadpool(call, *args, **kwargs)
        except StorageUnavailable:
            await asyncio.sleep(STORAGE_RETRY)


#: How often old answers are looked for [s].
_PERIOD = 60.0


async def purge(jobs: JobStore, settings: Settings) -> None:
    """Forget ended jobs that are too old or too many, if the storage can be used."""
    oldest = time.time() - settings.job_lifetime
    with contextlib.suppress(StorageUnavailable):
        await run_in_threadpool(jobs.purge, oldest, settings.job_count, settings.job_storage)


async def purge_periodically(jobs: JobStore, settings: Settings) -> None:
    """Forget old answers once in a while, until it is cancelled."""
    while True:
        await purge(jobs, settings)
        await asyncio.sleep(_PERIOD)
