"""The fork server: it loads all that workers need, once, and forks a worker whenever it is told to.

Workers share its memory until they write to it. It has one thread, as have all processes that it
forks, so that no lock is ever held at a fork. Messages to the server are tuples ``(kind, ...)``,
see `Notice`; one from the server is a byte, see `Order`.
"""

import contextlib
import fcntl
import gc
import os
import pickle
import select
import signal
import socket
import struct
import traceback
from collections.abc import Callable, Iterator, Sequence
from enum import Enum, StrEnum
from pkgutil import resolve_name
from typing import Any

from armwright_wire.base import build_at_once
from service.workers import main as worker
from service.workers.fork.launch import Recipe
from service.workers.task import load_tasks

#: Told how many of how many things are done, and how long the rest may take [s], if that is known.
Report = Callable[[int, int, float | None], None]

#: How much workers leave processors to others, above all to the server, which must answer at once
#: while all of them compute. Where nobody else wants a processor, it changes nothing.
_NICENESS = 5


class Notice(StrEnum):
    """The kinds of messages a fork server sends."""

    PROGRESS = "progress"  # (done, total, seconds left or None) of what it prepares
    WARM = "warm"  # it can fork workers that can answer
    UNFIT = "unfit"  # (trace) it could not warm up, and ends
    FORKED = "forked"  # (pid) the worker that was asked for, in the order of asking
    EXITED = "exited"  # (pid, exit code) as subprocess has it: negative for a signal
    ENRICHED = "enriched"  # workers that are forked from now on have more prepared


def main(control: int, sentinel: int, recipe: Sequence[Any]) -> None:
    """Be a fork server until the server is gone; this does not return.

    Args:
        control: Descriptor of the stream to the server.
        sentinel: Descriptor of a pipe that ends when the server does.
        recipe: The fields of a `Recipe`.
    """
    # The server decides when this ends, also when a signal goes to the whole process group.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    end_with_server(sentinel)
    os.register_at_fork(after_in_child=lambda: end_with_server(sentinel))
    server = _ForkServer(socket.socket(fileno=control))
    with contextlib.suppress(EOFError, OSError):
        server.run(Recipe(*recipe))
    # Taking compiled kernels apart one by one takes seconds, and nothing needs to be put away.
    os._exit(0)


def end_with_server(sentinel: int) -> None:
    """Have the kernel end this process at the moment the server is gone.

    A signal with its default action works inside native code that never lets go of the
    interpreter, where neither an exception nor another thread would get a turn. The sentinel is a
    pipe on which nothing is ever sent, so the only event on it is that the server's end closes.

    Args:
        sentinel: Descriptor of the reading end. Every process opens it anew: who is signalled is
            a property of what was opened, which forked processes would share.
    """
    own = os.open(f"/proc/self/fd/{sentinel}", os.O_RDONLY | os.O_NONBLOCK)
    signal.signal(signal.SIGIO, signal.SIG_DFL)
    fcntl.fcntl(own, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(own, fcntl.F_SETFL, os.O_NONBLOCK | os.O_ASYNC)
    if select.select([own], [], [], 0)[0]:  # it was gone before the signal was set
        os._exit(0)


class Order(bytes, Enum):
    """The messages of the server."""

    FORK = b"f"  # a worker; with the descriptor of its channel
    ENRICH = b"e"  # prepare more, from now on
    TWIN = b"t"  # a fork server like this one; with the descriptor of its stream


class _ForkServer:
    """The loop of a fork server.

    Args:
        control: The stream to the server.
    """

    def __init__(self, control: socket.socket) -> None:
        self._control = control
        self._enriching = False
        self._open_wakeups()
        signal.signal(signal.SIGCHLD, lambda *_: None)

    def _open_wakeups(self) -> None:
        self._wakeups, self._wakes = socket.socketpair()
        self._wakes.setblocking(False)
        self._wakeups.setblocking(False)
        signal.set_wakeup_fd(self._wakes.fileno(), warn_on_full_buffer=False)

    def run(self, recipe: Recipe) -> None:
        """Load, then fork until the server is gone.

        Raises:
            EOFError: The server is gone.
        """
        gc.disable()  # nearly all that is loaded stays
        try:
            for module in recipe.modules:
                load_tasks(module)
            build_at_once()
            resolve_name(recipe.warm)(self._progress)
        except Exception:  # noqa: BLE001  (whatever it is, the server logs it)
            self._send(Notice.UNFIT, traceback.format_exc())
            return
        # Whoever looks for garbage writes to all that it looks at, which ends the sharing of it.
        gc.freeze()
        self._send(Notice.WARM)
        while not self._enriching or recipe.enrich is None:
            self._serve(None)
        self._enrich(resolve_name(recipe.enrich)())
        gc.freeze()
        self._send(Notice.ENRICHED)
        while True:
            self._serve(None)

    def _enrich(self, steps: Iterator[object]) -> None:
        try:
            for _ in steps:
                self._serve(0.0)
        except EOFError:
            raise
        except Exception:  # noqa: BLE001  (workers can do without)
            traceback.print_exc()

    def _progress(self, done: int, total: int, remaining: float | None) -> None:
        self._send(Notice.PROGRESS, done, total, remaining)

    def _serve(self, timeout: float | None) -> None:
        """Obey orders and report what has ended; wait for either [s]."""
        while True:
            ready, _, _ = select.select([self._control, self._wakeups], [], [], timeout)
            if self._wakeups in ready:
                self._wakeups.recv(4096)
                self._report_exits()
            if self._control in ready:
                self._obey()
            if timeout is None or not ready:
                return

    def _obey(self) -> None:
        order, channels, _, _ = socket.recv_fds(self._control, 1, 1)
        if not order:
            raise EOFError("the server is gone")
        if order == Order.ENRICH:
            self._enriching = True
        elif order == Order.TWIN:
            self._fork_twin(*channels)
        else:
            self._fork(*channels)

    def _fork_twin(self, channel: int) -> None:
        """Fork a fork server that has prepared what this one has, and goes on as it does."""
        # By a process between the two, so that it is no child of this one: its workers alone are.
        told, tells = os.pipe()
        between = os.fork()
        if between == 0:
            twin = os.fork()
            if twin != 0:
                os.write(tells, struct.pack("=q", twin))
                os._exit(0)
            os.close(told)
            os.close(tells)
            for inherited in (self._control, self._wakeups, self._wakes):
                inherited.close()
            self._control = socket.socket(fileno=channel)
            self._open_wakeups()
            self._send(Notice.WARM)
            return
        os.close(channel)
        os.close(tells)
        (pid,) = struct.unpack("=q", os.read(told, 8))
        os.close(told)
        os.waitpid(between, 0)
        self._send(Notice.FORKED, pid)

    def _fork(self, channel: int) -> None:
        pid = os.fork()
        if pid == 0:
            self._be_worker(channel)
        os.close(channel)
        self._send(Notice.FORKED, pid)

    def _be_worker(self, channel: int) -> None:
        try:
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            for inherited in (self._control, self._wakeups, self._wakes):
                inherited.close()
            gc.enable()
            os.nice(_NICENESS)
            worker.main(socket.socket(fileno=channel))
        except BaseException:  # noqa: BLE001  (a worker never goes on as a fork server)
            traceback.print_exc()
        finally:
            os._exit(0)

    def _report_exits(self) -> None:
        while True:
            try:
                pid, status = os.waitpid(-1, os.WNOHANG)
            except ChildProcessError:
                return
            if pid == 0:
                return
            self._send(Notice.EXITED, pid, os.waitstatus_to_exitcode(status))

    def _send(self, kind: Notice, *values: Any) -> None:
        self._control.sendall(worker.encode(pickle.dumps((kind.value, *values))))
