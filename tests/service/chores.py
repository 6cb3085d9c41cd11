"""Task functions that do to a worker what can happen to one."""

import itertools
import os
import signal
import socket
import time
from collections.abc import Iterator
from functools import partial
from typing import Any

from kinematics.errors import InvalidLinkName
from service.workers import current, main
from service.workers.fork.server import Report
from service.workers.task import task


def no_warming(report: Report) -> None:
    """Nothing to compile."""


def failing_warming(report: Report) -> None:
    raise RuntimeError("no compiler")


def slow_warming(report: Report) -> None:
    """Two kernels, of which the second takes for ever."""
    report(0, 2, None)
    report(1, 2, 30.4)
    burn()


_ENRICHED: list[int] = []


def enriching() -> Iterator[None]:
    for step in range(3):
        _ENRICHED.append(step)
        time.sleep(0.2)
        yield


def failing_enriching() -> Iterator[None]:
    _ENRICHED.append(0)
    yield
    raise RuntimeError("too rich")


@task
def enriched() -> list[int]:
    return _ENRICHED


@task
def add(a: int, b: int) -> int:
    return a + b


@task
def echo(value: Any) -> Any:
    return value


@task
def nap(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


@task
def burn() -> None:
    """Hold the interpreter in native code, so that no exception and no thread gets a turn."""
    sum(itertools.repeat(1, 10**13))


_HOARD: list[bytearray] = []


@task
def hoard(size: int) -> int:
    """Keep memory that is in use [byte]."""
    _HOARD.append(bytearray(b"x") * size)
    return os.getpid()


@task
def die(number: int = signal.SIGSEGV) -> None:
    os.kill(os.getpid(), number)
    time.sleep(5.0)


@task
def blame_caller() -> None:
    raise InvalidLinkName("no link 'x'", hint="Choose 'a' or 'b'.", link="x", choices=["a", "b"])


@task
def stumble() -> None:
    raise ZeroDivisionError("a secret")


@task
def unpicklable() -> Any:
    return lambda: None


@task
def advance() -> str:
    for step in range(4):
        current.report(step / 4, f"step_{step}")
        time.sleep(0.06)
    return "done"


@task
def remaining() -> float:
    return current.deadline().remaining


@task
def surroundings() -> dict[str, Any]:
    import numba

    return {
        "threads": {n: v for n, v in os.environ.items() if n.endswith("_NUM_THREADS")},
        "numba": numba.get_num_threads(),
        "pid": os.getpid(),
        "parent": os.getppid(),
    }


def worker(channel: socket.socket) -> None:
    """A worker that can do chores."""
    main.main(channel)


def impatient_worker(channel: socket.socket) -> None:
    """A worker that ends itself soon after a deadline that the server does not enforce."""
    main._SELF_KILL = 0.2
    main.main(channel)


@task
def search(found: float) -> str:
    """Find something better again and again, and never come to an end."""
    for step in itertools.count():
        current.offer(partial("found {}".format, step))
        time.sleep(found)
    return "done"


@task
def find_and_die() -> None:
    current.offer(lambda: "found")
    time.sleep(0.1)
    os.kill(os.getpid(), signal.SIGKILL)


@task
def nap_over(seconds: float, content: bytes) -> int:
    """A job of a size."""
    time.sleep(seconds)
    return len(content)
