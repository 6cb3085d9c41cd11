"""One service and one browser for all tests of the studio."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

from armwright_client import Client
from service.app import create_app
from service.settings import Settings
from studio.workbench import Workbench
from tests.service.server import serving
from tests.service.viewer.browser import browsing


@pytest.fixture(scope="package")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("studio")
    with serving(create_app(Settings(data_dir=folder, workers=1))) as http:
        yield str(http.base_url)


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    with browsing() as opened:
        yield opened


@pytest.fixture
def workbench(url: str) -> Iterator[Workbench]:
    with Client(url) as client:
        yield Workbench(client, url, "panda")
