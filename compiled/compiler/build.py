"""Compilation of a list of kernels in several processes, those first that others call."""

import ctypes
import gc
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any

from compiled.compiler import store
from compiled.compiler.fingerprint import callees
from compiled.compiler.kernel_list import Entry

#: Has the system send a process a signal when the one that started it ends (`man prctl`).
_SET_PARENT_DEATH_SIGNAL = 1
#: Added to the weight of every entry: what compiling costs that does not grow with the code [kB].
_FIXED_WEIGHT = 4


#: Called with the number of kernels that are compiled, of all that were to be compiled, and with an
#: estimate of the time that is left [s], None before there is one.
Report = Callable[[int, int, float | None], object]


class BuildFailed(RuntimeError):
    """A process that compiled kernels died."""


def missing_entries(entries: Sequence[Entry]) -> list[Entry]:
    """The entries of a list whose machine code is not on disk."""
    return [one for one in entries if not all(map(store.has, one.files))]


def build(
    entries: Sequence[Entry],
    processes: int,
    report: Report = lambda *_: None,
) -> list[str]:
    """Compile kernels and store their machine code; stored code stays when a process is killed.

    Each process compiles one kernel at a time, and none before all kernels that it calls are there.

    Args:
        entries: the kernels, none of which is on disk.
        processes: how many work at once.
        report: called at the beginning and after each kernel.

    Returns:
        Errors of kernels that Python calls and that can't be compiled.

    Raises:
        BuildFailed: a process died.
    """
    plan = _Plan(entries)
    start = time.monotonic()
    report(0, len(entries), None)
    context = multiprocessing.get_context("fork")
    crew = [_Worker(context, entries) for _ in range(min(processes, len(entries)))]
    try:
        while plan.done < len(entries):
            for worker in (one for one in crew if one.task is None):
                worker.begin(plan.next(idle=all(one.task is None for one in crew)))
            for worker in _answering(crew):
                plan.finish(*worker.answer())
                report(plan.done, len(entries), plan.remaining(time.monotonic() - start))
    finally:
        for worker in crew:
            worker.end()
    return plan.failures


class _Plan:
    """Order of compiling: kernels that may be compiled next, and those that are done.

    Args:
        entries: the kernels.
    """

    def __init__(self, entries: Sequence[Entry]) -> None:
        self.done = 0
        self.failures: list[str] = []
        self._entries = entries
        self._weights = [one.weight + _FIXED_WEIGHT for one in entries]
        self._compiled = 0
        numbers: dict[Any, list[int]] = {}
        for number, entry in enumerate(entries):
            numbers.setdefault(entry.kernel.py_func, []).append(number)
        self._waits = [
            {n for callee in callees(one.kernel.py_func) for n in numbers.get(callee, ())}
            for one in entries
        ]
        for number, waits in enumerate(self._waits):
            waits.discard(number)
        self._urgency = self._path_weights()
        self._open = set(range(len(entries)))

    def next(self, idle: bool) -> int | None:
        """The number of the most urgent entry whose callees are there; None where there is none.

        Args:
            idle: whether nothing is being compiled; any entry will do then, and what it needs is
                compiled on the way, or refused if kernels call each other in a circle.
        """
        ready = [number for number in self._open if idle or not self._waits[number]]
        ready = [number for number in ready if not self._waits[number]] or ready
        if not ready:
            return None
        number = max(ready, key=lambda one: (self._urgency[one], -one))
        self._open.remove(number)
        return number

    def finish(self, number: int, error: str | None) -> None:
        """Note that an entry is compiled, or can't be."""
        self.done += 1
        self._compiled += self._weights[number]
        for waits in self._waits:
            waits.discard(number)
        # A kernel that only kernels call may be listed for types that nobody uses any more.
        if error is not None and self._entries[number].door:
            self.failures.append(f"{self._entries[number].name}: {error}")

    def remaining(self, seconds: float) -> float:
        """Time that is left [s], if some that took so long are done."""
        return seconds * (sum(self._weights) - self._compiled) / self._compiled

    def _path_weights(self) -> list[int]:
        """The weight of each entry and of the heaviest chain of callers above it."""
        callers: list[list[int]] = [[] for _ in self._entries]
        for number, waits in enumerate(self._waits):
            for callee in waits:
                callers[callee].append(number)
        known: dict[int, int] = {}

        def above(number: int) -> int:
            if number not in known:
                known[number] = 0  # of kernels that call themselves by way of others
                higher = max((above(caller) for caller in callers[number]), default=0)
                known[number] = self._weights[number] + higher
            return known[number]

        return [above(number) for number in range(len(self._entries))]


class _Worker:
    """A process that compiles the kernels that it is sent.

    Args:
        context: of multiprocessing.
        entries: what there is to compile.
    """

    def __init__(self, context: Any, entries: Sequence[Entry]) -> None:
        self.task: int | None = None
        self.pipe, other = context.Pipe()
        self._process = context.Process(target=_work, args=(other, self.pipe, entries), daemon=True)
        self._process.start()
        other.close()

    def begin(self, number: int | None) -> None:
        """Have it compile an entry, if there is one."""
        self.task = number
        if number is not None:
            self.pipe.send(number)

    def answer(self) -> tuple[int, str | None]:
        """The number of the entry that it has compiled, and what went wrong."""
        number, self.task = self.task, None
        assert number is not None
        try:
            return number, self.pipe.recv()
        except EOFError:
            self._process.join()
            code = self._process.exitcode
            raise BuildFailed(f"a process that compiled kernels ended with {code}") from None

    def end(self) -> None:
        """End the process, whatever it is doing."""
        self._process.kill()
        self._process.join()
        self.pipe.close()


def _answering(crew: Sequence[_Worker]) -> Iterator[_Worker]:
    answers = wait([worker.pipe for worker in crew if worker.task is not None])
    return (worker for worker in crew if worker.pipe in answers)


def _work(pipe: Connection, other: Connection, entries: Sequence[Entry]) -> None:
    ctypes.CDLL(None).prctl(_SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)
    gc.freeze()  # what was imported stays, and need not be looked through for garbage
    other.close()  # so that the end of the first process is noticed where it came before that
    try:
        while True:
            entry = entries[pipe.recv()]
            try:
                entry.kernel.build(entry.kinds, entry.door)
            except Exception as error:  # noqa: BLE001  numba raises all kinds; it is passed on
                pipe.send(f"{type(error).__name__}: {error}")
            else:
                pipe.send(None)
    except (OSError, EOFError, KeyboardInterrupt):
        os._exit(1)
