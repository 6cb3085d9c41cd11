"""Chores of the server: prepared files and kept plans stay bounded, and freed memory goes back."""

import asyncio
import contextlib
import ctypes
import time
from collections.abc import Callable

from starlette.concurrency import run_in_threadpool

from service.http.state import retention
from service.settings import Settings
from service.storage import prepared_files
from service.storage.database import StorageUnavailable
from service.storage.plan_store import PlanStore

#: How often the chores are done [s].
_PERIOD = 30.0
#: The parameter M_ARENA_MAX of glibc's mallopt(3).
_ARENA_MAX = -8


async def keep_house(settings: Settings, plans: PlanStore) -> None:
    """Do the chores, for ever."""
    release = _memory_release()
    while True:
        folder, limit = str(settings.prepared_dir), settings.prepared_storage
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
