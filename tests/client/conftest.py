"""One real service for all tests of this folder: its own process, with workers."""

import os
import subprocess
import time
from collections.abc import Iterator

import pytest

from armwright_client import Client, NotReady, Scene
from tests.client.world import TABLE
from tests.service.commands import start_command
from tests.service.kernel_store import frozen_kernels

#: Kernels that no earlier run left compiled take a minute or two [s].
_WARMING = 240.0


@pytest.fixture(scope="package", autouse=True)
def _no_request_compiles() -> Iterator[None]:
    """The first request that needs a kernel which is not on the list fails."""
    with frozen_kernels():
        yield


@pytest.fixture(scope="session")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Where the service listens."""
    folder = tmp_path_factory.mktemp("service")
    arguments = ["serve", "--port", "0", "--workers", "1", "--data-dir", str(folder / "data")]
    environment = {**os.environ, "ARMWRIGHT_DEFAULT_TIMEOUT": "60"}
    with (folder / "log").open("w") as log:
        process = start_command(arguments, stdout=subprocess.PIPE, stderr=log, env=environment)
    try:
        assert process.stdout is not None
        said = process.stdout.readline()
        assert said, (folder / "log").read_text()
        address = said.split()[-1]
        with Client(address) as client:
            wait_until_ready(client)
        yield address
    finally:
        process.terminate()
        process.communicate(timeout=30)


def wait_until_ready(client: Client) -> None:
    end = time.monotonic() + _WARMING
    while True:
        try:
            client.readyz()
        except NotReady:
            assert time.monotonic() < end, "the service does not become ready"
            time.sleep(0.2)
        else:
            return


@pytest.fixture
def client(url: str) -> Iterator[Client]:
    """A client of the service."""
    with Client(url) as client:
        yield client


@pytest.fixture
def table(client: Client) -> Iterator[str]:
    """A stored scene, forgotten afterwards."""
    client.scenes.replace("table", Scene(obstacles=[TABLE]))
    yield "table"
    client.scenes.delete("table")
