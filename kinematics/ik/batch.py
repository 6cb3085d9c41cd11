"""Batches of poses shared among threads, as kernels run without the interpreter lock."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

#: Poses that are worth a thread.
_SHARE = 100


def shared(part: Callable[[slice], None], count: int, threads: int | None = None) -> None:
    """Call ``part`` for slices that make up range(count), one in each thread.

    Args:
        part: Works on its slice alone.
        count: Number of poses.
        threads: Number of threads; all the processors that this process may use where not given.
            Few poses get fewer.
    """
    workers = min(threads or processors(), count // _SHARE + 1)
    if workers == 1:
        part(slice(0, count))
        return
    parts = [slice(i * count // workers, (i + 1) * count // workers) for i in range(workers)]
    # The caller's own thread has nothing better to do.
    with ThreadPoolExecutor(workers - 1) as pool:
        others = [pool.submit(part, some) for some in parts[1:]]
        part(parts[0])
        for other in others:
            other.result()


def processors() -> int:
    """Number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
