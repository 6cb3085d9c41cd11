"""Calls of the storage that are repeated until the storage can be used."""

import asyncio
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from starlette.concurrency import run_in_threadpool

from service.storage.database import StorageUnavailable

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
