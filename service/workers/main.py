"""The life of a worker process: warm up, then one task after another until the server is gone.

Messages from the server are jobs; messages to the server are tuples ``(kind, ...)``, see `Reply`.
"""

import contextlib
import fcntl
import importlib
import math
import multiprocessing
import os
import pickle
import select
import signal
import socket
import struct
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from kinematics.errors import ArmwrightError
from service.workers import framing

#: How long after its deadline a worker ends itself, should the server have failed to do it [s].
_SELF_KILL = 5.0
#: Progress within a stage is told at most this often [s].
_REPORT_PERIOD = 0.05
#: In front of each job: its deadline, and whether somebody wants to know how far it is.
HEADER = struct.Struct("!d?")


@dataclass(frozen=True, slots=True)
class Job:
    """One call of a task function in a worker.

    Args:
        task: Where the function is, as ``"service.tasks.robots:plan"``.
        args: Positional arguments, picklable.
        kwargs: Named arguments, picklable.
    """

    task: str
    args: tuple[Any, ...] = ()
    kwargs: Mapping[str, Any] = field(default_factory=dict)


class Reply(StrEnum):
    """The kinds of messages a worker sends."""

    READY = "ready"  # warm, waiting for the first job
    UNFIT = "unfit"  # (trace) could not warm up
    STARTED = "started"  # the job has arrived
    PROGRESS = "progress"  # (fraction, stage)
    RESULT = "result"  # (value)
    FAULT = "fault"  # (code, message, hint, details) the caller's
    BUG = "bug"  # (trace) ours


class _Current:
    """The job that this process is working on; a worker has one at a time."""

    channel: socket.socket | None = None
    deadline: float = math.inf
    heard: bool = False
    stage: str | None = None
    last_report: float = 0.0


def deadline() -> float:
    """When the current job must be done, on the clock of `time.monotonic` [s]; inf if never."""
    return _Current.deadline


def report(progress: float, stage: str) -> None:
    """Tell the server how far the current job is.

    Args:
        progress: From 0 to 1.
        stage: What is being done, in a word.
    """
    if _Current.channel is None or not _Current.heard:
        return
    now = time.monotonic()
    if stage != _Current.stage or now - _Current.last_report >= _REPORT_PERIOD:
        _Current.stage, _Current.last_report = stage, now
        _send(_Current.channel, Reply.PROGRESS, float(progress), stage)


def resolve(task: str, modules: Sequence[str]) -> Callable[..., Any]:
    """The public function that a path such as ``"service.tasks.robots:plan"`` names.

    Raises:
        LookupError: The module is not one of `modules`, or has no such function of its own.
    """
    module_name, _, name = task.partition(":")
    if module_name not in modules:
        raise LookupError(f"{task!r}: tasks come from {', '.join(modules)}")
    function = getattr(importlib.import_module(module_name), name, None)
    if name.startswith("_") or getattr(function, "__module__", None) != module_name:
        raise LookupError(f"{task!r}: {module_name} defines no such public function")
    if not callable(function):
        raise LookupError(f"{task!r} is not a function")
    return function  # type: ignore[no-any-return]


def main(channel: socket.socket, modules: Sequence[str], warm: Callable[[], object]) -> None:
    """Be a worker: the target of each worker process.

    Args:
        channel: The stream to the server; when it closes, the worker ends.
        modules: The modules whose functions may be called.
        warm: Called once before the worker counts as ready.
    """
    # The server decides when its workers end, also when a signal goes to the whole process group.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    _end_with_server()
    with channel, contextlib.suppress(EOFError, OSError):
        try:
            warm()
        except Exception:  # noqa: BLE001  (whatever it is, the server logs it)
            _send(channel, Reply.UNFIT, traceback.format_exc())
            return
        _send(channel, Reply.READY)
        while True:
            payload = framing.receive(channel)
            _send(channel, Reply.STARTED)
            _send(channel, *_attended(channel, payload, modules))


def _end_with_server() -> None:
    """Have the kernel end this process at the moment the server is gone.

    A signal with its default action works inside native code that never lets go of the
    interpreter, where neither an exception nor another thread would get a turn. The sentinel is a
    pipe on which nothing is ever sent, so the only event on it is that the server's end closes.
    """
    server = multiprocessing.parent_process()
    if server is None:
        return
    flags = fcntl.fcntl(server.sentinel, fcntl.F_GETFL)
    signal.signal(signal.SIGIO, signal.SIG_DFL)
    fcntl.fcntl(server.sentinel, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(server.sentinel, fcntl.F_SETFL, flags | os.O_ASYNC)
    if select.select([server.sentinel], [], [], 0)[0]:  # it was gone before the signal was set
        raise SystemExit


def _attended(channel: socket.socket, payload: bytes, modules: Sequence[str]) -> tuple[Any, ...]:
    _Current.deadline, _Current.heard = HEADER.unpack_from(payload)
    content = memoryview(payload)[HEADER.size :]
    _Current.channel, _Current.stage = channel, None
    if math.isfinite(_Current.deadline):
        # The server ends what overruns; this is for a server that no longer gets to it.
        remaining = max(_Current.deadline - time.monotonic(), 0.0)
        signal.setitimer(signal.ITIMER_REAL, remaining + _SELF_KILL)
    try:
        return _outcome(content, modules)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        _Current.channel, _Current.deadline = None, math.inf


def _outcome(content: memoryview, modules: Sequence[str]) -> tuple[Any, ...]:
    try:
        job: Job = pickle.loads(content)
        value = resolve(job.task, modules)(*job.args, **job.kwargs)
        return Reply.RESULT, value
    except ArmwrightError as error:
        return Reply.FAULT, error.code, error.message, error.hint, dict(error.details)
    except Exception:  # noqa: BLE001  (whatever it is, it must not take the worker along)
        return Reply.BUG, traceback.format_exc()


def _send(channel: socket.socket, kind: Reply, *values: Any) -> None:
    try:
        payload = pickle.dumps((kind.value, *values), pickle.HIGHEST_PROTOCOL)
    except Exception:  # noqa: BLE001  (details of a fault may be anything)
        payload = pickle.dumps((Reply.BUG.value, traceback.format_exc()))
    channel.sendall(framing.encode(payload))
