"""The clients: `Client` waits for its answers, `AsyncClient` lets others run meanwhile."""

from typing import Self, Unpack

import httpx

from armwright_client.call import AsyncGroup, Group
from armwright_client.endpoints import (
    JobEndpoints,
    RobotEndpoints,
    SceneEndpoints,
    ServiceEndpoints,
)
from armwright_client.session import AsyncSession, ClientOptions, Session, Wire

#: Where the service listens unless it is told otherwise.
DEFAULT_URL = "http://127.0.0.1:8000"


class Robots(RobotEndpoints, Group):
    """Robots: stored models, and what is computed of one of them."""


class AsyncRobots(RobotEndpoints, AsyncGroup):
    """`Robots` to be awaited."""


class Scenes(SceneEndpoints, Group):
    """Scenes: stored obstacles, and projections onto them."""


class AsyncScenes(SceneEndpoints, AsyncGroup):
    """`Scenes` to be awaited."""


class Jobs(JobEndpoints, Group):
    """Jobs: work that goes on after it was accepted."""


class AsyncJobs(JobEndpoints, AsyncGroup):
    """`Jobs` to be awaited."""


class Client(ServiceEndpoints, Group):
    """A service at a URL; threads may share it.

    Args:
        base_url: Where the service is, with a prefix if it has one.
        transport: In place of the network, as in httpx: a proxy, certificates, an application.
        options: `token`, `timeout` and `retry`, see `ClientOptions`.

    Raises:
        InvalidArgument: The URL or the token can't be one.
    """

    def __init__(
        self,
        base_url: str = DEFAULT_URL,
        *,
        transport: httpx.BaseTransport | None = None,
        **options: Unpack[ClientOptions],
    ) -> None:
        self._session = Session(Wire(base_url, **options), transport)
        super().__init__(self._session)
        self.robots = Robots(self._session)
        self.scenes = Scenes(self._session)
        self.jobs = Jobs(self._session)

    def close(self) -> None:
        """Close all connections."""
        self._session.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


class AsyncClient(ServiceEndpoints, AsyncGroup):
    """`Client` whose methods are to be awaited, for asyncio."""

    def __init__(
        self,
        base_url: str = DEFAULT_URL,
        *,
        transport: httpx.AsyncBaseTransport | None = None,
        **options: Unpack[ClientOptions],
    ) -> None:
        self._session = AsyncSession(Wire(base_url, **options), transport)
        super().__init__(self._session)
        self.robots = AsyncRobots(self._session)
        self.scenes = AsyncScenes(self._session)
        self.jobs = AsyncJobs(self._session)

    async def close(self) -> None:
        """Close all connections."""
        await self._session.close()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *exception: object) -> None:
        await self.close()
