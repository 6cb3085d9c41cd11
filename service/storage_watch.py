"""A watch over storage that could not be used: it is tried until it can be used again."""

import asyncio
import logging

from starlette.concurrency import run_in_threadpool

from service.storage.database import Database, StorageUnavailable

_log = logging.getLogger(__name__)
#: How often it is looked for a fault, and storage with one is tried [s].
_PERIOD = 1.0


async def watch(database: Database) -> None:
    """Try a database that could not be used until it can be; runs until it is cancelled."""
    while True:
        await asyncio.sleep(_PERIOD)
        fault = database.fault
        if fault is None:
            continue
        _log.warning("the storage can't be used: %s", fault)
        try:
            await run_in_threadpool(database.probe)
        except StorageUnavailable:
            continue
        _log.warning("the storage can be used again")
