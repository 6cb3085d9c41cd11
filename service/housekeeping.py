"""Chores of the server: files and plans stay bounded, freed memory goes back, storage is probed."""

import asyncio
import contextlib
import ctypes
import logging
import time
from collections.abc import Callable

from starlette.concurrency import run_in_threadpool

from service.http.state import retention
from service.settings import Settings
from service.storage.caches import prepared_files
from service.storage.database import Database, StorageUnavailable
from service.storage.stores.plan_store import PlanStore

_log = logging.getLogger(__name__)
#: How often it is looked for a fault, and storage with one is tried [s].
_PROBE_PERIOD = 1.0


async def watch_storage(database: Database) -> None:
    """Try a database that could not be used until it can be; runs until it is cancelled."""
    while True:
        await asyncio.sleep(_PROBE_PERIOD)
        fault = database.fault
        if fault is None:
            continue
        _log.warning("the storage can't be used: %s", fault)
        try:
            await run_in_threadpool(database.probe)
        except StorageUnavailable:
            continue
        _log.warning("the storage can be used again")


#: How often the chores are done [s].
_PERIOD = 30.0
#: The parameter M_ARENA_MAX of glibc's mallopt(3).
_ARENA_MAX = -8


async def keep_house(settings: Settings, plans: PlanStore) -> None:
    """Do the chores, for ever."""
    release = _memory_release()
    while True:
        folder, limit = settings.prepared_dir, settings.prepared_storage
        await run_in_threadpool(prepared_files.trim, folder, limit)
        with contextlib.suppress(StorageUnavailable):
            await run_in_threadpool(plans.purge, time.time(), retention(settings))
        # Large bodies and answers leave the allocator with memory that it does not give back.
        await run_in_threadpool(release)
        await asyncio.sleep(_PERIOD)


def take_one_arena() -> None:
    """Have the C library take memory from one arena, where it has arenas.

    By default each thread has one of its own, and what they have given back lies in pieces that are
    no whole pages: 6 MiB after five minutes of mixed work, 2 with one arena. Python's lock lets
    threads take turns anyway. To be called before there are threads.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).mallopt(_ARENA_MAX, 1)


def _memory_release() -> Callable[[], object]:
    """The function of the C library that gives freed memory back, where there is one."""
    with contextlib.suppress(OSError, AttributeError):
        trim = ctypes.CDLL(None).malloc_trim
        return lambda: trim(0)
    return lambda: None
