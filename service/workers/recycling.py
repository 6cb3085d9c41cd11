"""Memory and age of workers: what one may have, and when another takes its place."""

import contextlib
import resource
import time
from typing import NamedTuple

from service.workers.process import MemoryMeter, Worker

_MEBIBYTE = 2**20


class WorkerLimits(NamedTuple):
    """Limits of one worker.

    Attributes:
        memory: what a worker may ask the system for beyond what it was forked with [byte].
        growth: what a worker may keep after a job beyond that [byte]: caches and what is lost.
        jobs: jobs after which another worker takes its place.
        age: time after which another worker takes its place [s].
    """

    memory: int = 2048 * _MEBIBYTE
    growth: int = 512 * _MEBIBYTE
    jobs: int = 10_000
    age: float = 6 * 3600.0


DEFAULT_LIMITS = WorkerLimits()


def limit_memory(pid: int, limits: WorkerLimits) -> None:
    """Have the system refuse a worker more memory than it may have.

    Args:
        pid: The worker, which was just forked.
        limits: Of a worker.
    """
    meter = MemoryMeter(pid)
    limit = meter.size + limits.memory
    meter.close()
    # A worker that has died already, or of another user, has no limit set.
    with contextlib.suppress(OSError):
        resource.prlimit(pid, resource.RLIMIT_AS, (limit, limit))


def is_worn(worker: Worker, limits: WorkerLimits) -> bool:
    """Whether another worker is to take the place of one that has just done a job."""
    if worker.jobs >= limits.jobs or time.monotonic() - worker.born >= limits.age:
        return True
    resident = 0 if worker.memory is None else worker.memory.resident
    return resident - worker.resident_at_first > limits.growth
