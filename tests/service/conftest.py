from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest
from fastapi import FastAPI
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter

from service.app import create_app
from service.settings import Settings
from service.task_references import RECIPE
from service.tracing.tracer import Tracing
from service.workers.supervisor import WorkerSupervisor
from tests.service.http.exchange import LIMIT, add_mishaps
from tests.service.kernel_store import frozen_kernels
from tests.service.postgresql import PostgreSQL
from tests.service.postgresql import postgresql as postgresql_server
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


@pytest.fixture(scope="package", autouse=True)
def _no_request_compiles() -> Iterator[None]:
    """The first request that needs a kernel which is not on the list fails."""
    with frozen_kernels():
        yield


@pytest.fixture(scope="session")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """One service with two workers for all tests: what they store has names of their own."""
    data = tmp_path_factory.mktemp("served")
    app = create_app(Settings(data_dir=data, workers=2))
    with serving(app) as client:
        yield Served(app, client, data)


@pytest.fixture(scope="session")
def client(served: Served) -> httpx.Client:
    return served.client


@pytest.fixture(scope="session")
def spans() -> InMemorySpanExporter:
    """The spans of the application with paths that fail."""
    return InMemorySpanExporter()


@pytest.fixture(scope="session")
def faulty_app(tmp_path_factory: pytest.TempPathFactory, spans: InMemorySpanExporter) -> FastAPI:
    """An application with one worker, small bodies, traces, and paths that fail in every way."""
    settings = Settings(
        data_dir=tmp_path_factory.mktemp("faulty"),
        workers=1,
        queue_limit=1,
        max_body_size=LIMIT,
        body_timeout=0.5,
    )
    app = create_app(settings, tracing=Tracing(spans, at_once=True))
    add_mishaps(app)
    return app


@pytest.fixture(scope="session")
def faulty_client(faulty_app: FastAPI) -> Iterator[httpx.Client]:
    """A client of the application with paths that fail."""
    with pytest.MonkeyPatch.context() as patch:
        more = (*RECIPE.modules, "tests.service.chores")
        patch.setattr("service.app.RECIPE", RECIPE._replace(modules=more, enrich=None))
        with serving(faulty_app) as client:
            yield client


@pytest.fixture(scope="session")
def postgresql() -> Iterator[PostgreSQL]:
    """A PostgreSQL server, started for the first test that asks for one."""
    with postgresql_server() as server:
        yield server
