"""One real service for all tests of this folder: its own process, with workers."""

from collections.abc import Iterator

import pytest

from armwright_client import Client, Scene
from tests.client.world import TABLE
from tests.service.commands import serve
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
    settings = {"DEFAULT_TIMEOUT": "60", "LOG_LEVEL": "error", "WORKERS": "1"}
    environment = {f"ARMWRIGHT_{name}": value for name, value in settings.items()}
    folder = tmp_path_factory.mktemp("service")
    with serve(folder, environment=environment, longest=_WARMING) as (_, client):
        yield str(client.base_url)


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
