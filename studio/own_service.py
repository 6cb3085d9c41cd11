"""A service of the studio's own, in a process beside it."""

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from armwright_client import ArmwrightError, Client, NotReady, TransportError

#: Between two questions whether the service is ready [s].
_PERIOD = 0.2
#: Kernels that were never compiled take minutes on a small machine [s].
_START_TIME = 900.0
#: A service that was asked to end has so long for the requests that run [s].
_STOP_TIME = 10.0


@contextmanager
def own_service(data_dir: Path | None) -> Iterator[str]:
    """Start a service on a free port of this machine, and stop it behind the block.

    Args:
        data_dir: Folder of its database; the user's data if None.

    Yields:
        Address of the service, once it is ready.

    Raises:
        RuntimeError: It ends before it is ready, or does not become ready.
    """
    port = _free_port()
    folder = [] if data_dir is None else ["--data-dir", str(data_dir)]
    command = [sys.executable, "-m", "command_line.main", "serve", "--port", str(port), *folder]
    with subprocess.Popen([*command, "--log-level", "warning"]) as process:
        url = f"http://127.0.0.1:{port}"
        try:
            _wait_until_ready(url, process)
            yield url
        finally:
            process.terminate()
            try:
                process.wait(_STOP_TIME)
            except subprocess.TimeoutExpired:
                process.kill()


def _wait_until_ready(url: str, process: subprocess.Popen[bytes]) -> None:
    end = time.monotonic() + _START_TIME
    with Client(url) as client:
        while time.monotonic() < end:
            if process.poll() is not None:
                raise RuntimeError(f"the service ended with exit code {process.returncode}")
            try:
                client.readyz()
            except (NotReady, TransportError):
                time.sleep(_PERIOD)
            except ArmwrightError as error:
                raise RuntimeError(f"the service answers {error}") from error
            else:
                return
    raise RuntimeError(f"the service is not ready after {_START_TIME:.0f} s")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port
