"""The server's side of a fork server."""

import asyncio
import contextlib
import logging
import os
import pickle
import signal
import socket
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from service.workers import main
from service.workers.fork.launch import Launched
from service.workers.fork.server import Notice, Order

_log = logging.getLogger(__name__)

#: Place of a process's state among the fields of ``/proc/<pid>/stat`` behind its name.
_STATE = 0
#: Place of its exit status.
_EXIT_STATUS = 49
_GONE = ("gone",)
#: State of a process that has ended and whose exit code nobody has asked for.
_DEAD = "Z"
#: States of processes that a signal or a debugger has stopped.
_STOPPED = ("T", "t")
#: How often the system is asked for the exit code of a process that is dying [s].
_LOOK_PERIOD = 0.02


class ForkServerLost(Exception):
    """The fork server has ended."""


@dataclass(slots=True, eq=False)
class WorkerProcess:
    """A worker process that was forked.

    Args:
        pid: Number of the process.
        exited: Exit code once the process has ended; None if nobody knows it any more.
    """

    pid: int
    exited: "asyncio.Future[int | None]"

    def kill(self) -> None:
        """End the process, whatever it is doing, unless it has ended."""
        if not self.exited.done():
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)

    @property
    def is_stopped(self) -> bool:
        """Whether a signal or a debugger has stopped the process."""
        return (self._status() or _GONE)[_STATE] in _STOPPED

    async def exit_code(self, seconds: float) -> int | None:
        """The exit code of a process that is dying; None if it is not known within `seconds`.

        The fork server tells it; while that is busy, the system does, until it is told.
        """
        end = time.monotonic() + seconds
        while not self.exited.done() and time.monotonic() < end:
            status = self._status()
            if status is not None and status[_STATE] == _DEAD:
                return os.waitstatus_to_exitcode(int(status[_EXIT_STATUS]))
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(asyncio.shield(self.exited), _LOOK_PERIOD)
        return self.exited.result() if self.exited.done() else None

    def _status(self) -> list[str] | None:
        """The fields of the process in ``/proc`` from its state on; None if it is not there."""
        try:
            text = Path(f"/proc/{self.pid}/stat").read_text()
        except OSError:
            return None
        return text.rpartition(")")[2].split()


class Twin(NamedTuple):
    """A fork server that another one has forked.

    Attributes:
        process: its process.
        control: the stream to it.
    """

    process: WorkerProcess
    control: socket.socket

    def reap(self) -> None:
        """End the fork server alone; its workers go on."""
        self.control.close()
        self.process.kill()

    def end(self) -> None:
        """End the fork server; its workers end with those of the one that forked it."""
        self.reap()


class ForkServer:
    """The server's side of a fork server; all its methods belong to one event loop.

    Args:
        launched: The process, which may still be loading.
        on_notice: Told of what is none of the workers': PROGRESS, WARM, UNFIT, ENRICHED.
    """

    def __init__(
        self, launched: Launched | Twin, on_notice: Callable[[Notice, Sequence[Any]], None]
    ) -> None:
        self.lost = asyncio.Event()
        self._launched = launched
        self._on_notice = on_notice
        self._decoder = main.FrameDecoder()
        self._warm = asyncio.Event()
        self._enriching = False
        self._asked: deque[asyncio.Future[WorkerProcess]] = deque()
        self._living: dict[int, WorkerProcess] = {}
        launched.control.setblocking(False)
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(launched.control, self._receive)

    @property
    def holds_workers(self) -> bool:
        """Whether workers live for as long as this is not ended: a twin's have another's end."""
        return isinstance(self._launched, Launched)

    async def fork(self, channel: socket.socket) -> WorkerProcess:
        """Fork a worker once the fork server is warm.

        Args:
            channel: The worker's end of its stream, which is closed here.

        Raises:
            ForkServerLost: The fork server ended before.
        """
        return await self._fork(Order.FORK, channel)

    async def fork_twin(self, on_notice: Callable[[Notice, Sequence[Any]], None]) -> "ForkServer":
        """Fork a fork server that has prepared all that this one has, and outlives it.

        Args:
            on_notice: Told of what is none of its workers'.

        Raises:
            ForkServerLost: The fork server ended before.
        """
        control, theirs = socket.socketpair()
        try:
            process = await self._fork(Order.TWIN, theirs)
        except BaseException:
            control.close()
            raise
        return ForkServer(Twin(process, control), on_notice)

    async def _fork(self, order: Order, channel: socket.socket) -> WorkerProcess:
        with channel:
            await self._warm.wait()
            if self.lost.is_set():
                raise ForkServerLost
            forked: asyncio.Future[WorkerProcess] = self._loop.create_future()
            try:
                socket.send_fds(self._launched.control, [order.value], [channel.fileno()])
            except OSError:
                self._lose()
                raise ForkServerLost from None
            self._asked.append(forked)
        return await asyncio.shield(forked)

    def enrich(self) -> None:
        """Have it prepare more, between forks, unless it was told so before."""
        if not self._enriching and not self.lost.is_set():
            self._enriching = True
            with contextlib.suppress(OSError):  # whoever reads next learns that it is lost
                self._launched.control.send(Order.ENRICH.value)

    async def reap(self) -> None:
        """End the process, but not its workers."""
        self._lose()
        await asyncio.to_thread(self._launched.reap)

    async def end(self) -> None:
        """End the process and all its workers, whatever they are doing."""
        self._lose()
        await asyncio.to_thread(self._launched.end)

    def _receive(self) -> None:
        try:
            data = self._launched.control.recv(65536)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._lose()
            return
        for payload in self._decoder.feed(data):
            kind, *values = pickle.loads(payload)
            self._handle(Notice(kind), values)

    def _handle(self, kind: Notice, values: Sequence[Any]) -> None:
        if kind == Notice.FORKED:
            process = WorkerProcess(values[0], self._loop.create_future())
            self._living[process.pid] = process
            self._asked.popleft().set_result(process)
        elif kind == Notice.EXITED:
            pid, code = values
            ended = self._living.pop(pid, None)
            if ended is not None:
                ended.exited.set_result(code)
        else:
            if kind == Notice.WARM:
                self._warm.set()
            self._on_notice(kind, values)

    def _lose(self) -> None:
        if self.lost.is_set():
            return
        self._loop.remove_reader(self._launched.control)
        self.lost.set()
        self._warm.set()  # whoever waits for it learns that it is lost
        while self._asked:
            asked = self._asked.popleft()
            asked.set_exception(ForkServerLost())
            asked.exception()  # it may be that nobody waits any more
        for process in self._living.values():
            process.exited.set_result(None)
        self._living.clear()
