"""Streams of server-sent events: of a job of this server, and of one that another has."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable

from service.jobs.live_job import LiveJob, describe
from service.storage.job_store import ENDED, JobAnswer, JobRecord

#: How often the database is asked where a job of another server stands [s].
_POLL_PERIOD = 0.5
_SIGN_OF_LIFE = b": keep-alive\n\n"


async def follow_live(
    live: LiveJob, after: int, closing: asyncio.Event, keep_alive: float
) -> AsyncIterator[bytes]:
    """The events of a job of this server, as they come.

    Args:
        live: The job.
        after: The number of the last event that was received.
        closing: Set when the service ends.
        keep_alive: Longest silence [s].
    """
    while True:
        changed = live.changed
        for event in live.since(after):
            after = event.number
            yield event.encode()
        if live.has_ended or live.is_gone or closing.is_set():
            return
        if not await _is_set(keep_alive, changed, closing):
            yield _SIGN_OF_LIFE


async def follow_stored(
    get: Callable[[], Awaitable[tuple[JobRecord, JobAnswer | None]]],
    after: int,
    closing: asyncio.Event,
    keep_alive: float,
) -> AsyncIterator[bytes]:
    """The events of a job that is in the database only, as they are seen there.

    Args:
        get: Reads the job.
        after: The number of the last event that was received.
        closing: Set when the service ends.
        keep_alive: Longest silence [s].
    """
    clock = asyncio.get_running_loop().time
    told = clock()
    while True:
        record, answer = await get()
        ended = record.status in ENDED
        if record.event > after:
            after, told = record.event, clock()
            failed = record.status == "failed" and answer is not None
            error = answer.content if failed and answer is not None else None
            yield describe(record, "end" if ended else "status", error).encode()
        if ended or closing.is_set():
            return
        if clock() - told >= keep_alive:
            told = clock()
            yield _SIGN_OF_LIFE
        await _is_set(min(_POLL_PERIOD, keep_alive), closing)


async def _is_set(timeout: float, *events: asyncio.Event) -> bool:
    """Wait for the first of some events, but not for ever; whether there was one."""
    waiting = [asyncio.ensure_future(event.wait()) for event in events]
    try:
        done, _ = await asyncio.wait(waiting, timeout=timeout, return_when=asyncio.FIRST_COMPLETED)
        return bool(done)
    finally:
        for future in waiting:
            future.cancel()
