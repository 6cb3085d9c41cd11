"""What the system says of processes."""

import fcntl
import os
import sys
import termios
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from service.workers.process import Worker
from service.workers.supervisor import WorkerSupervisor


def alive(pid: int) -> bool:
    """Whether a process is there and not just waiting to be reaped."""
    try:
        status = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return status.rpartition(")")[2].split()[0] not in "ZX"


def children(pid: int) -> set[int]:
    """The processes that one has started, but for those that wait to be reaped."""
    return {child for child, parent in _parents().items() if parent == pid and alive(child)}


def descendants(pid: int) -> set[int]:
    """All processes below one, at any depth."""
    parents = _parents()
    found = {pid}
    while True:
        more = {child for child, parent in parents.items() if parent in found} - found
        if not more:
            return found - {pid}
        found |= more


def settled(supervisor: WorkerSupervisor) -> bool:
    """Whether all workers live, and nobody will replace one of them meanwhile."""
    count = supervisor.count
    return wait_until(
        lambda: supervisor.settled and supervisor.ready and supervisor.alive == count, 90.0
    )


def kill_in_work(supervisor: WorkerSupervisor, *numbers: int) -> None:
    """End the worker of the only job that runs, once for each signal.

    What has not reached its worker is sent to another one, which is no attempt.
    """
    for count, number in enumerate(numbers, supervisor.counters.crashed + 1):
        victims: set[int] = set()
        assert wait_until(partial(_has_begun, supervisor, victims), 20.0), "no worker has begun"
        for pid in victims:
            os.kill(pid, number)
        assert wait_until(partial(_has_counted, supervisor, count), 20.0), "it outlives a signal"


def working_pids(supervisor: WorkerSupervisor) -> set[int]:
    """The process numbers of the workers that have received a job."""
    return {
        worker.process.pid
        for worker in supervisor._pool.workers
        if worker.ticket is not None and not worker.ending and _has_read_all(worker)
    }


def _has_read_all(worker: Worker) -> bool:
    """Whether a worker has read all that it was sent, as the system knows (unix(7): SIOCOUTQ)."""
    transport = worker._transport
    if transport is None or transport.get_write_buffer_size() > 0:
        return False
    unread = fcntl.ioctl(transport.get_extra_info("socket").fileno(), termios.TIOCOUTQ, bytes(4))
    return int.from_bytes(unread, sys.byteorder) == 0


def _has_begun(supervisor: WorkerSupervisor, found: set[int]) -> bool:
    found |= working_pids(supervisor)
    return bool(found)


def _has_counted(supervisor: WorkerSupervisor, count: int) -> bool:
    return supervisor.counters.crashed >= count


def _parents() -> dict[int, int]:
    parents: dict[int, int] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            parents[int(entry.name)] = int(fields[1])
    return parents


def wait_until(condition: Callable[[], bool], seconds: float) -> bool:
    """Whether a condition came true in time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.02)
    return condition()
