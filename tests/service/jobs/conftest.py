"""A service of their own for tests of jobs, since these end its workers."""

from collections.abc import Iterator

import httpx
import pytest

from service.app import create_app
from service.settings import Settings
from tests.service.conftest import Served
from tests.service.robots import (
    answer,
    bench,
)
from tests.service.server import serving


@pytest.fixture(scope="package")
def jobs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A service of its own, since these tests kill its workers."""
    data = tmp_path_factory.mktemp("jobs")
    settings = Settings(data_dir=data, workers=2, batch_limit=40, keep_alive=0.2, queue_limit=8)
    app = create_app(settings)
    with serving(app) as client:
        answer(client.post("/v1/robots", json=bench("stuck")), 201)
        yield Served(app, client, data)


@pytest.fixture
def client(jobs: Served) -> httpx.Client:
    return jobs.client
