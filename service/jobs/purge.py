"""Old answers of jobs, forgotten when a job ends and once in a while."""

import asyncio
import contextlib
import time

from starlette.concurrency import run_in_threadpool

from service.settings import Settings
from service.storage.database import StorageUnavailable
from service.storage.stores.job_store import JobStore

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
