from collections.abc import Iterator

import httpx
import pytest

from tests.course.in_process import service_in_process
from tests.course.robots import ROBOTS


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """The service with the arms of the course notes."""
    with service_in_process(tmp_path_factory.mktemp("course")) as client:
        for robot in ROBOTS:
            stored = client.post("/v1/robots", json=robot)
            assert stored.status_code == 201, stored.text
        yield client
