from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest
from fastapi import FastAPI

from service.app import create_app
from service.settings import Settings
from service.workers.supervisor import WorkerSupervisor
from tests.service.server import serving


@dataclass(frozen=True)
class Served:
    """A running service, from outside and from inside."""

    app: FastAPI
    client: httpx.Client
    data: Path

    @property
    def supervisor(self) -> WorkerSupervisor:
        supervisor: WorkerSupervisor = self.app.state.supervisor
        return supervisor


@pytest.fixture(scope="session")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """One service with two workers for all tests: what they store has names of their own."""
    data = tmp_path_factory.mktemp("served")
    app = create_app(Settings(data_dir=data, workers=2))
    with serving(app) as client:
        yield Served(app, client, data)


@pytest.fixture
def client(served: Served) -> httpx.Client:
    return served.client
