"""Task functions that do to a worker what can happen to one."""

import itertools
import os
import signal
import time
from typing import Any

from kinematics.errors import InvalidLinkName
from service.workers import main


def no_warming() -> None:
    """Nothing to compile."""


def failing_warming() -> None:
    raise RuntimeError("no compiler")


def add(a: int, b: int) -> int:
    return a + b


def echo(value: Any) -> Any:
    return value


def nap(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def burn() -> None:
    """Hold the interpreter in native code, so that no exception and no thread gets a turn."""
    sum(itertools.repeat(1, 10**13))


def die(number: int = signal.SIGSEGV) -> None:
    os.kill(os.getpid(), number)
    time.sleep(5.0)


def blame_caller() -> None:
    raise InvalidLinkName("no link 'x'", hint="Choose 'a' or 'b'.", link="x", choices=["a", "b"])


def stumble() -> None:
    raise ZeroDivisionError("a secret")


def unpicklable() -> Any:
    return lambda: None


def advance() -> str:
    for step in range(4):
        main.report(step / 4, f"step_{step}")
        time.sleep(0.06)
    return "done"


def remaining() -> float:
    return main.deadline() - time.monotonic()


def surroundings() -> dict[str, Any]:
    import numba

    return {
        "threads": {n: v for n, v in os.environ.items() if n.endswith("_NUM_THREADS")},
        "numba": numba.get_num_threads(),
        "pid": os.getpid(),
    }
