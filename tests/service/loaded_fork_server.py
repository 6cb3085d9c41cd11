"""Fork servers for tests, forked from one process that has loaded all that workers need.

Loading takes four seconds of a processor, and a run of the tests starts dozens of services. What is
forked here does all that `service.workers.fork.server.main` does, and finds it loaded. Tests of the
start of services, and of what is below their processes, use fork servers that load by themselves.
"""

import atexit
import os
import pickle
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, cached_property
from io import FileIO
from pathlib import Path
from typing import Any, cast
from unittest.mock import patch

from service.workers.fork import server
from service.workers.fork.launch import _THREADS, Launched, Recipe
from service.workers.fork.launch import launch as launch_and_load
from service.workers.task import load_tasks
from tests.compiled.forked import Ran, fork_programs, run

_MAIN = """\
import sys
sys.path[:] = {path!r}
from tests.service.loaded_fork_server import main
main({channel}, {programs})
"""
#: What comes with an order: the stream, the sentinel, where to tell the number of the process, and
#: its output and errors.
_DESCRIPTORS = 5
_ORDER_BYTES = 1 << 20
#: What services prepare; other recipes are those of tests of workers.
_PREPARES = "service.warm_up.kernels:prepare"


@contextmanager
def loaded_fork_servers() -> Iterator[None]:
    """Services of this process have fork servers that find all loaded."""
    with patch("service.workers.pool.launch", _launch):
        yield


def launch_by(loaded: socket.socket) -> Callable[[Recipe], Launched]:
    """What launches fork servers in another process than that of the tests.

    Args:
        loaded: The stream to the process that has loaded all.
    """
    return lambda recipe: _launch(recipe, loaded)


def _launch(recipe: Recipe, loaded: socket.socket | None = None) -> Launched:
    """A fork server for a service in this process, as `launch` gives it.

    Args:
        recipe: What it loads.
        loaded: The stream to the process that has loaded all; one of this process if left out.
    """
    if recipe.warm != _PREPARES:
        return launch_and_load(recipe)
    control, theirs = socket.socketpair()
    watched, write_end = os.pipe()
    told, tells = os.pipe()
    order = pickle.dumps((tuple(recipe), os.environ | _THREADS, str(Path.cwd())))
    given = (theirs.fileno(), watched, tells, 1, 2)
    socket.send_fds(loaded or loaded_process(), [order], given)
    theirs.close()
    os.close(watched)
    os.close(tells)
    process = cast("subprocess.Popen[bytes]", _Process(told))
    return Launched(process, control, FileIO(write_end, "wb"))


class _Process:
    """A process that is no child of this one, as far as a `Launched` needs it.

    Its parent never asks for its exit code, so that no other process gets its number.

    Args:
        told: Descriptor of a pipe that tells its number once it is there.
    """

    def __init__(self, told: int) -> None:
        self._told = open(told, "rb")  # noqa: SIM115

    @cached_property
    def pid(self) -> int:
        with self._told:
            return int(self._told.read())

    @cached_property
    def _descriptor(self) -> int:
        return os.pidfd_open(self.pid)

    def kill(self) -> None:
        if self.poll() is None:
            signal.pidfd_send_signal(self._descriptor, signal.SIGKILL)

    def poll(self) -> int | None:
        return 0 if select.select([self._descriptor], [], [], 0.0)[0] else None

    def wait(self) -> int:
        select.select([self._descriptor], [], [])
        return 0

    def __del__(self) -> None:
        os.close(self._descriptor)


def loaded_process() -> socket.socket:
    """The stream to the process that has loaded all; it ends with this one."""
    return _loaded()[0]


def run_where_ready(program: str, folder: Path, variables: Mapping[str, str] = {}) -> Ran:
    """Run a program in a new process that is as ready for requests as a service's.

    Modules and machine code are loaded, and no request was answered, not even one of our own.

    Args:
        program: Python.
        folder: Where it runs.
        variables: More than this process has.
    """
    return run(program, folder, variables, lambda: _loaded()[1])


@cache
def _loaded() -> tuple[socket.socket, socket.socket]:
    """The streams to the process that has loaded all, and to its twin that runs programs."""
    programs, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        loaded = forking_process(_MAIN, {"programs": theirs.fileno()}, env=os.environ | _THREADS)
    return loaded, programs


def forking_process(
    code: str, passed: Mapping[str, int] | None = None, **options: Any
) -> socket.socket:
    """The stream to a process that forks others; it ends with this one.

    Args:
        code: What it runs, with ``path`` and ``channel`` to be filled in, and what is ``passed``.
        passed: Descriptors that it takes over, by their names in the code.
        options: Of `subprocess.Popen`.
    """
    channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    path = [os.path.abspath(folder) for folder in sys.path]  # noqa: PTH100
    given = {"channel": theirs.fileno(), **(passed or {})}
    with theirs:
        process = subprocess.Popen(
            [sys.executable, "-P", "-c", code.format(path=path, **given)],
            stdin=subprocess.DEVNULL,
            pass_fds=tuple(given.values()),
            **options,
        )

    def end() -> None:
        channel.close()
        process.kill()
        process.wait()

    atexit.register(end)
    return channel


def main(descriptor: int, programs: int) -> None:
    """Load, then fork a fork server for each order until the process of the tests is gone.

    Args:
        descriptor: Of the stream to it.
        programs: Of the stream by which it asks for programs to be run.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    from service.recipe import RECIPE
    from service.warm_up import kernels

    for module in RECIPE.modules:
        load_tasks(module)
    kernels.prepare(lambda *_: None)
    if os.fork() == 0:
        os.close(descriptor)
        fork_programs(programs)
    os.close(programs)
    for _ in kernels.enrich():
        pass
    with socket.socket(fileno=descriptor) as channel:
        while True:
            order, descriptors, _, _ = socket.recv_fds(channel, _ORDER_BYTES, _DESCRIPTORS)
            if not order:
                os._exit(0)
            control, sentinel, tells, out, errors = descriptors
            pid = os.fork()
            if pid == 0:
                channel.close()
                os.close(tells)
                _be_fork_server(control, sentinel, (out, errors), *pickle.loads(order))
            os.write(tells, str(pid).encode())
            for one in descriptors:
                os.close(one)


def _be_fork_server(
    control: int,
    sentinel: int,
    output: tuple[int, int],
    recipe: tuple[Any, ...],
    environment: dict[str, str],
    folder: str,
) -> None:
    """Be a fork server with the surroundings of who asked for it; this does not return."""
    try:
        for usual, given in enumerate(output, 1):
            os.dup2(given, usual)
            os.close(given)
        os.environ.clear()
        os.environ.update(environment)
        os.chdir(folder)
        server.main(control, sentinel, recipe)
    finally:
        os._exit(1)
