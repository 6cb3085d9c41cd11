"""The life of a worker process: one task after another until the server is gone.

Messages have their length in front. Those from the server are jobs; those to the server are tuples
``(kind, ...)``, see `Reply`.
"""

import contextlib
import math
import pickle
import signal
import socket
import struct
import time
import traceback
from collections.abc import Iterator
from enum import StrEnum
from functools import partial
from typing import Any

from kinematics.errors import ArmwrightError
from planning.values.deadline import Deadline
from service.storage.caches.cache_key import NotPrepared
from service.workers import current
from service.workers.result import CacheMiss
from service.workers.task import registered_task, unpack_job

_LENGTH = struct.Struct("!Q")
#: One gibibyte: far above any request (bodies are capped), so only garbage is longer.
_MAX_LENGTH = 1 << 30


def encode(payload: bytes) -> bytes:
    """The payload with its length in front."""
    return _LENGTH.pack(len(payload)) + payload


def prefix(length: int) -> bytes:
    """Bytes in front of a payload of a length [byte]."""
    return _LENGTH.pack(length)


class FrameDecoder:
    """Cuts a stream of bytes, arriving in any pieces, back into the payloads that were sent."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Take what arrived and give each payload that is now complete.

        Raises:
            ValueError: The length is impossible, so the stream is not ours.
        """
        if not self._buffer and len(data) > _LENGTH.size:
            (length,) = _LENGTH.unpack_from(data)
            if len(data) == _LENGTH.size + length:  # as nearly all arrive
                yield data[_LENGTH.size :]
                return
        self._buffer += data
        while len(self._buffer) >= _LENGTH.size:
            (length,) = _LENGTH.unpack_from(self._buffer)
            if length > _MAX_LENGTH:
                raise ValueError(f"a frame of {length} bytes")
            end = _LENGTH.size + length
            if len(self._buffer) < end:
                return
            with memoryview(self._buffer) as view:  # one copy, not two
                payload = bytes(view[_LENGTH.size : end])
            del self._buffer[:end]
            yield payload


def receive(channel: socket.socket) -> bytes:
    """Wait for one payload.

    Raises:
        EOFError: The other side is gone.
    """
    (length,) = _LENGTH.unpack(_read(channel, _LENGTH.size))
    return _read(channel, length)


def _read(channel: socket.socket, length: int) -> bytes:
    buffer = bytearray(length)
    view = memoryview(buffer)
    while view:
        count = channel.recv_into(view)
        if count == 0:
            raise EOFError("the other side closed the channel")
        view = view[count:]
    return bytes(buffer)


#: How long after its deadline a worker ends itself, should the server have failed to do it [s];
#: longer than the grace of any task.
_SELF_KILL = 5.0
#: Code of the problem that a request needs too much memory.
_OUT_OF_MEMORY = "OUT_OF_MEMORY"
#: Codes of faults that tasks find in the midst of their work; all others they find before it.
_FAULTS_OF_WORK = frozenset({"TIMED_OUT", _OUT_OF_MEMORY})
#: In front of each job: its deadline [s], whether its beginning is to be reported, whether progress
#: is, and the time from its beginning in which none is [s].
HEADER = struct.Struct("!d??d")


class Reply(StrEnum):
    """The kinds of messages a worker sends."""

    READY = "ready"  # warm, waiting for the first job
    STARTED = "started"  # the job has arrived, where that is to be reported
    PROGRESS = "progress"  # (fraction, stage)
    OFFER = "offer"  # (value) the best result so far
    # The last three begin with how long the worker has had the job [s]. A server that is late to
    # read them would take that for the work of the job.
    RESULT = "result"  # (seconds, value)
    FAULT = "fault"  # (seconds, code, message, hint, details) the caller's
    BUG = "bug"  # (seconds, trace) ours


def is_refusal(kind: Reply, outcome: Any) -> bool:
    """Whether a reply says that nothing was computed: how long that took tells nothing of others.

    Args:
        kind: Kind of the reply.
        outcome: The first value behind the seconds.
    """
    if kind == Reply.FAULT:
        return outcome not in _FAULTS_OF_WORK
    return bool(getattr(outcome, "is_refusal", False))


def main(channel: socket.socket) -> None:
    """Be a worker, in a process where all tasks are registered and warm.

    Args:
        channel: The stream to the server; when it closes, the worker ends.
    """
    with channel, contextlib.suppress(EOFError, OSError):
        _send(channel, Reply.READY)
        while True:
            payload = receive(channel)
            began = time.monotonic()
            kind, *values = _run(channel, payload)
            del payload
            _send(channel, kind, time.monotonic() - began, *values)
            if kind == Reply.FAULT and values[0] == _OUT_OF_MEMORY:
                return  # nobody knows what is left undone


def _run(channel: socket.socket, payload: bytes) -> tuple[Any, ...]:
    """Run the job of a message and give the reply."""
    at, tells_start, wants_progress, silence = HEADER.unpack_from(payload)
    if tells_start:
        _send(channel, Reply.STARTED)
    deadline = Deadline(at)
    if math.isfinite(at):
        # The server ends what overruns; this is for a server that no longer gets to it.
        signal.setitimer(signal.ITIMER_REAL, deadline.remaining + _SELF_KILL)
    report = partial(_send, channel, Reply.PROGRESS) if wants_progress else None
    current.begin(deadline, report, silence, partial(_send, channel, Reply.OFFER))
    try:
        return _reply(memoryview(payload)[HEADER.size :])
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        current.end()


def _reply(content: memoryview) -> tuple[Any, ...]:
    try:
        job = unpack_job(content)
        return Reply.RESULT, registered_task(job.task)(*job.args, **job.kwargs)
    except MemoryError:
        return (
            Reply.FAULT,
            _OUT_OF_MEMORY,
            "the request needs more memory than one request may have",
            "Ask for less: fewer configurations, coarser meshes, shorter motions.",
            {"stage": "worker"},
        )
    except NotPrepared as error:
        return Reply.RESULT, CacheMiss(error.reference)
    except ArmwrightError as error:
        return Reply.FAULT, error.code, error.message, error.hint, dict(error.details)
    except Exception:  # noqa: BLE001  (whatever it is, it must not take the worker along)
        return Reply.BUG, traceback.format_exc()


def _send(channel: socket.socket, kind: Reply, *values: Any) -> None:
    try:
        payload = pickle.dumps((kind.value, *values), pickle.HIGHEST_PROTOCOL)
    except Exception:  # noqa: BLE001  (details of a fault may be anything)
        payload = pickle.dumps((Reply.BUG.value, 0.0, traceback.format_exc()))
    channel.sendall(encode(payload))
