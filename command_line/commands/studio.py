"""The commands ``armwright studio``, a page for people, and ``armwright mcp``, tools for models."""

import signal
import socket
import subprocess
import sys
import time
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

import armwright_client
from command_line.output import print_line
from command_line.parameters import Connection, command
from command_line.problems import invalid_value, unreachable

#: Packages of each extra, and the client, by the names that they are imported by.
_NEEDED = {
    "studio": ("armwright_client", "httpx", "viser"),
    "mcp": ("armwright_client", "httpx", "mcp"),
}


@command
def studio(
    connection: Connection,
    robot: Annotated[
        str | None,
        typer.Option(help="Robot to begin with; that of the last session if left out."),
    ] = None,
    port: Annotated[
        int, typer.Option(help="Port of the page; the next free one if it is taken.", min=0)
    ] = 8080,
    data_dir: Annotated[
        Path | None, typer.Option(help="Folder of the database of the service that is started.")
    ] = None,
    show: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the page in a browser.")
    ] = True,
) -> None:
    """Serve a page on this machine to set up, plan and watch motions."""
    _need("studio")

    def announce(address: str) -> None:
        print_line(f"Armwright studio: {address} (Ctrl+C ends it)")
        if show:
            webbrowser.open(address)

    # Whoever ends the studio politely ends the service that it started, too.
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        _serve(connection, data_dir, robot, port, announce)
    except KeyboardInterrupt:
        print_line("Ended.")
    finally:
        signal.signal(signal.SIGTERM, before)


@command
def mcp(
    url: Annotated[
        str, typer.Option(envvar="ARMWRIGHT_URL", help="Address of the service.")
    ] = "http://127.0.0.1:8000",
    token: Annotated[
        str | None, typer.Option(envvar="ARMWRIGHT_TOKEN", help="API key of that service.")
    ] = None,
) -> None:
    """Serve tools to a language model over standard input and output (MCP)."""
    _need("mcp")
    from command_line.mcp_server import mcp_server  # noqa: PLC0415

    options: armwright_client.ClientOptions = {} if token is None else {"token": token}
    try:
        client = armwright_client.AsyncClient(url, **options)
    except armwright_client.InvalidArgument as error:
        raise invalid_value("--url or --token", str(error)) from None
    mcp_server(client, url).run()


def _need(extra: str) -> None:
    """Refuse a command whose extra is not installed."""
    missing = [name for name in _NEEDED[extra] if find_spec(name) is None]
    if missing:
        install = f'pip install "armwright[{extra}]"'
        raise invalid_value(extra, f"{', '.join(missing)} can't be imported", install)


def _serve(
    connection: Connection,
    data_dir: Path | None,
    robot: str | None,
    port: int,
    announce: Callable[[str], None],
) -> None:
    from studio.page.studio_page import run  # noqa: PLC0415

    options: armwright_client.ClientOptions = (
        {} if connection.token is None else {"token": connection.token}
    )
    with _service(connection, data_dir) as url:
        try:
            with armwright_client.Client(url, **options) as client:
                run(client, url, robot, port, announce)
        except armwright_client.ArmwrightError as error:
            raise unreachable(
                f"{url}: {error}", "See that it runs, or leave --url out to start one."
            ) from None


@contextmanager
def _service(connection: Connection, data_dir: Path | None) -> Iterator[str]:
    """The address of the service at --url, or of one that is started here."""
    if connection.url is not None:
        yield connection.url
        return
    print_line("Starting a service; the first time kernels are compiled, which takes a minute.")
    try:
        with own_service(data_dir) as url:
            yield url
    except RuntimeError as error:
        raise unreachable(str(error), "Start one with `armwright serve` and give --url.") from None


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
    with armwright_client.Client(url) as client:
        while time.monotonic() < end:
            if process.poll() is not None:
                raise RuntimeError(f"the service ended with exit code {process.returncode}")
            try:
                client.readyz()
            except (armwright_client.NotReady, armwright_client.TransportError):
                time.sleep(_PERIOD)
            except armwright_client.ArmwrightError as error:
                raise RuntimeError(f"the service answers {error}") from error
            else:
                return
    raise RuntimeError(f"the service is not ready after {_START_TIME:.0f} s")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port
