"""A supervisor of workers for tests in an event loop."""

from collections.abc import AsyncIterator
from typing import Any

import pytest

from service.workers.supervisor import WorkerSupervisor
from tests.service.workers.pools import ready, supervisor


@pytest.fixture
def anyio_backend() -> str:
    """The event loop of tests that are coroutines."""
    return "asyncio"


@pytest.fixture
async def workers(request: pytest.FixtureRequest) -> AsyncIterator[WorkerSupervisor]:
    """A supervisor that is ready: of one worker, or as `pools.supervised` says."""
    options: dict[str, Any] = getattr(request, "param", {"count": 1})
    async with supervisor(**options) as made:
        await ready(made)
        yield made
