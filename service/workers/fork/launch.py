"""Start of the fork server: the process that loads everything once, and forks workers.

Only the standard library is imported here, so that the fork server begins to load before the server
itself does: on two cores both load at the same time.
"""

import os
import socket
import subprocess
import sys
from io import FileIO
from typing import NamedTuple

_MAIN = """\
import sys
sys.path[:] = {path!r}
from service.workers.fork.server import main
main({control}, {sentinel}, {recipe!r})
"""
#: One job a process, one process a core: threads inside would only get in each other's way.
_THREADS = {
    f"{library}_NUM_THREADS": "1"
    for library in ("OMP", "OPENBLAS", "MKL", "NUMBA", "VECLIB_MAXIMUM")
}


class Recipe(NamedTuple):
    """Preparation of a fork server before it forks workers; functions are named ``"module:name"``.

    Attributes:
        modules: packages and modules whose tasks may be called.
        warm: called with a `Report`, before there are workers: makes them able to answer.
        enrich: gives steps that are taken one by one between forks, once all workers are there;
            when all are taken, workers are forked anew. None if left out.
    """

    modules: tuple[str, ...]
    warm: str
    enrich: str | None = None


class Launched(NamedTuple):
    """A fork server that was started.

    Attributes:
        process: its process.
        control: the stream to it.
        sentinel: end of a pipe; it and all its workers end when this is closed.
    """

    process: "subprocess.Popen[bytes]"
    control: socket.socket
    sentinel: FileIO

    def reap(self) -> None:
        """End the fork server alone; its workers go on."""
        self.control.close()
        self.process.kill()
        self.process.wait()

    def end(self) -> None:
        """End the fork server and its workers, whatever they are doing."""
        self.sentinel.close()
        self.reap()


def launch(recipe: Recipe) -> Launched:
    """Start a fork server, which loads meanwhile.

    Raises:
        OSError: No process can be started.
    """
    control, theirs = socket.socketpair()
    watched, write_end = os.pipe()
    sentinel = FileIO(write_end, "wb")
    try:
        with theirs:
            code = _MAIN.format(
                path=[os.path.abspath(folder) for folder in sys.path],  # noqa: PTH100
                control=theirs.fileno(),
                sentinel=watched,
                recipe=tuple(recipe),
            )
            process = subprocess.Popen(
                # Not the current folder: a folder `service` there would be taken for ours.
                [sys.executable, "-P", "-c", code],
                stdin=subprocess.DEVNULL,
                env=os.environ | _THREADS,
                pass_fds=(theirs.fileno(), watched),
            )
    except BaseException:
        control.close()
        sentinel.close()
        raise
    finally:
        os.close(watched)
    return Launched(process, control, sentinel)
