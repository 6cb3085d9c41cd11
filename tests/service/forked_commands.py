"""Commands of the service for tests, forked from one process that has loaded the server.

To import the server takes two seconds of a processor, and a run of the tests starts a dozen. What
is forked here is a process of its own with arguments, variables and output of its own, and its fork
servers find all loaded. Tests of the start itself run the command as people do.
"""

import contextlib
import gc
import os
import pickle
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

from tests.service.loaded_fork_server import forking_process, launch_by, loaded_process

_ROOT = Path(__file__).parents[2]
_MAIN = """\
import sys
sys.path[:] = {path!r}
from tests.service.forked_commands import main
main({channel}, {loaded})
"""
#: What comes with an order: output, errors, and where to tell the number and the end of a process.
_DESCRIPTORS = 3
_ORDER_BYTES = 1 << 20
#: Numbers of processes and what `os.waitpid` gives, as they are told.
_WIDTH = 8


def start_command(arguments: Sequence[str], **options: Any) -> "subprocess.Popen[str]":
    """Start a command of the service whose fork server finds all loaded.

    Args:
        arguments: Of the command.
        options: Of `subprocess.Popen`: where output and errors go, and the variables.
    """
    return _Forked(list(arguments), text=True, **options)


class _Forked(subprocess.Popen[str]):
    """A process that the loaded one has forked, as if it were a child of this one.

    Where `subprocess.Popen` starts a program and waits for a child, this one asks the loaded
    process. All else is inherited.
    """

    def _execute_child(self, *given: Any) -> None:
        # As CPython 3.11 to 3.13 calls it: (args, executable, preexec_fn, close_fds, pass_fds, cwd,
        # env, startupinfo, creationflags, shell, the six ends of pipes, and more).
        arguments, environment, pipes = given[0], given[6], given[10:16]
        told, tells = os.pipe()
        order = pickle.dumps((arguments, dict(os.environ if environment is None else environment)))
        written = [usual if end == -1 else end for usual, end in ((1, pipes[3]), (2, pipes[5]))]
        socket.send_fds(_server_process(), [order], [*written, tells])
        os.close(tells)
        self._close_pipe_fds(*pipes)  # type: ignore[attr-defined]
        self._told = told
        self.pid = self._read()
        self._child_created = True

    def _read(self) -> int:
        told = os.read(self._told, _WIDTH)
        assert told, "the loaded process has ended"
        return int.from_bytes(told, "little")

    def _try_wait(self, wait_flags: int) -> tuple[int, int]:
        if wait_flags & os.WNOHANG and not select.select([self._told], [], [], 0.0)[0]:
            return 0, 0
        status = self._read()
        os.close(self._told)
        return self.pid, status

    def _internal_poll(self, *_: Any, **__: Any) -> int | None:
        if self.returncode is None:
            pid, status = self._try_wait(os.WNOHANG)
            if pid == self.pid:
                self._handle_exitstatus(status)  # type: ignore[attr-defined]
        return self.returncode


@cache
def _server_process() -> socket.socket:
    """The stream to the process that has loaded the server; it ends with this one."""
    return forking_process(_MAIN, {"loaded": loaded_process().fileno()}, cwd=_ROOT)


def main(descriptor: int, loaded: int) -> None:
    """Load the server, then fork a command for each order until the process of the tests is gone.

    Args:
        descriptor: Of the stream to it.
        loaded: Of the stream to the process that has loaded what workers need.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    from service import app, cli, server  # noqa: F401

    gc.freeze()
    with socket.socket(fileno=descriptor) as channel:
        command = _next_command(channel)
    launch = launch_by(socket.socket(fileno=loaded))
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with patch("service.workers.fork.launch.launch", launch):
        sys.exit(command())


def _next_command(channel: socket.socket) -> Callable[[], int]:
    """What a forked process is to do; in the process that forks, this does not return."""
    running: dict[int, tuple[int, int]] = {}
    while True:
        for ready in select.select([channel.fileno(), *running], [], [])[0]:
            if ready in running:
                _tell_end(*running.pop(ready))
                os.close(ready)
                continue
            order, descriptors, _, _ = socket.recv_fds(channel, _ORDER_BYTES, _DESCRIPTORS)
            if not order:
                os._exit(0)
            pid = os.fork()
            if pid == 0:
                for watched, (_, tells) in running.items():
                    os.close(watched)
                    os.close(tells)
                return _take(order, descriptors)
            for one in descriptors[:2]:
                os.close(one)
            os.write(descriptors[2], pid.to_bytes(_WIDTH, "little"))
            running[os.pidfd_open(pid)] = pid, descriptors[2]


def _tell_end(pid: int, tells: int) -> None:
    _, status = os.waitpid(pid, 0)
    with contextlib.suppress(BrokenPipeError):  # nobody wants to know
        os.write(tells, status.to_bytes(_WIDTH, "little"))
    os.close(tells)


def _take(order: bytes, descriptors: Sequence[int]) -> Callable[[], int]:
    """Take over what came with an order."""
    for usual, given in zip((1, 2), descriptors[:2], strict=True):
        os.dup2(given, usual)
    for given in descriptors:
        os.close(given)
    arguments, environment = pickle.loads(order)
    os.environ.clear()
    os.environ.update(environment)
    from service.cli import main as command

    return lambda: command(arguments)
