"""Programs with kernels in new processes, forked from one that has made the compiler ready.

That takes most of the time of a program that compiles little. Where a variable is read meanwhile,
or by Python when it starts, the program runs in a process from the start.
"""

import atexit
import io
import os
import pickle
import socket
import subprocess
import sys
import tempfile
import traceback
import types
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
_MAIN = "from tests.compiled.forked import main; main({channel})"
_ORDER_BYTES = 1 << 18
#: Beginnings of the names of variables that are read when they are needed.
_READ_LATE = ("ARMWRIGHT_KERNELS", "NUMBA_CACHE_DIR")


class Ran(NamedTuple):
    """The end of a program.

    Attributes:
        code: Its exit status.
        out: What it printed.
        errors: What it complained about.
    """

    code: int
    out: str
    errors: str


def run(
    program: str,
    folder: Path,
    variables: Mapping[str, str],
    forks: Callable[[], socket.socket] | None = None,
) -> Ran:
    """Run a program in a new process.

    Args:
        program: Python.
        folder: Where its modules are, and where it runs.
        variables: More than this process has.
        forks: Gives the stream to the process that it is forked from, see `fork_programs`; one that
            has made the compiler ready if left out.
    """
    path = f"{ROOT}{os.pathsep}{folder}"
    environment = {**os.environ, "PYTHONPATH": path, **variables}
    if not all(name.startswith(_READ_LATE) for name in variables):
        answer = subprocess.run(
            [sys.executable, "-c", program], cwd=folder, capture_output=True, check=False,
            text=True, env=environment,
        )  # fmt: skip
        return Ran(answer.returncode, answer.stdout, answer.stderr)
    ended, ends = os.pipe()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as errors:
        order = pickle.dumps((program, str(folder), environment))
        given = (out.fileno(), errors.fileno(), ends)
        try:
            socket.send_fds((forks or _importer)(), [order], given)
        finally:
            os.close(ends)
        with io.FileIO(ended) as pipe:
            code = int(pipe.read() or b"-9")
        texts = []
        for file in (out, errors):
            file.seek(0)
            texts.append(file.read().decode())
    return Ran(code, *texts)


@cache
def _importer() -> socket.socket:
    """The stream to the process that has made the compiler ready; it ends with this one."""
    channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        process = subprocess.Popen(
            [sys.executable, "-c", _MAIN.format(channel=theirs.fileno())],
            cwd=ROOT, pass_fds=(theirs.fileno(),), stdin=subprocess.DEVNULL,
        )  # fmt: skip

    def end() -> None:
        channel.close()
        process.wait()

    atexit.register(end)
    return channel


def main(descriptor: int) -> None:
    """Make the compiler ready, then fork a process for each program until nobody asks any more.

    Args:
        descriptor: Of the stream to who asks.
    """
    from numba.core.registry import cpu_target

    import compiled.kernel  # noqa: F401
    from compiled.compiler.target import target

    # What the compiler does before it compiles anything, half a second's work: it reads the types
    # of all functions that it knows.
    target()
    cpu_target.typing_context.refresh()
    fork_programs(descriptor)


def fork_programs(descriptor: int) -> None:
    """Fork a process for each program until nobody asks any more; this does not return.

    Args:
        descriptor: Of the stream to who asks.
    """
    with socket.socket(fileno=descriptor) as channel:
        while True:
            order, descriptors, _, _ = socket.recv_fds(channel, _ORDER_BYTES, 3)
            if not order:
                os._exit(0)
            child = os.fork()
            if child == 0:
                channel.close()
                _be_program(descriptors, *pickle.loads(order))
            for one in descriptors:
                os.close(one)
            os.waitpid(child, 0)


def _be_program(
    descriptors: list[int], program: str, folder: str, environment: dict[str, str]
) -> None:
    """Run a program as a process of its own would; this does not return."""
    out, errors, ends = descriptors
    code = 0
    try:
        os.dup2(out, 1)
        os.dup2(errors, 2)
        os.environ.clear()
        os.environ.update(environment)
        os.chdir(folder)
        sys.path[:0] = ["", *environment["PYTHONPATH"].split(os.pathsep)]
        module = sys.modules["__main__"] = types.ModuleType("__main__")
        exec(compile(program, "<string>", "exec"), vars(module))
    except BaseException:  # noqa: BLE001  (whatever it is, it is the program's end)
        traceback.print_exc()
        code = 1
    sys.stdout.flush()
    os.write(ends, str(code).encode())
    os._exit(code)
