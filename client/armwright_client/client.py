"""The clients: `Client` waits for its answers, `AsyncClient` lets others run meanwhile."""

from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Sequence
from typing import Protocol, Self, TypeVar, Unpack

import httpx

from armwright_client.call import (
    AsyncGroup,
    AsyncLaterGroup,
    Group,
    LaterGroup,
    ended_async,
    wait_until_ended,
)
from armwright_client.endpoints import (
    JobEndpoints,
    PlanEndpoints,
    SceneEndpoints,
    ServiceEndpoints,
    ToolEndpoints,
)
from armwright_client.job import Job
from armwright_client.robot_endpoints import RobotEndpoints
from armwright_client.session import AsyncSession, ClientOptions, Session, Wire
from armwright_wire.plans.kept_plan import KeptPlanSummary
from armwright_wire.robots.robot import RobotSummary
from armwright_wire.scenes.scene import SceneSummary
from armwright_wire.scenes.tool import ToolSummary


class Page(Protocol):
    """A page of a list."""

    @property
    def next(self) -> str | None:
        """To be given as `after` for the next page, None on the last one."""


P = TypeVar("P", bound=Page)
T = TypeVar("T")


def items(read: Callable[[str | None], P], of: Callable[[P], Sequence[T]]) -> Iterator[T]:
    """All items of a list; each page is asked for when the one before it is used up.

    Args:
        read: The page after a key, the first page after None.
        of: The items of a page.
    """
    after = None
    while True:
        page = read(after)
        yield from of(page)
        after = page.next
        if after is None:
            return


async def items_async(
    read: Callable[[str | None], Awaitable[P]], of: Callable[[P], Sequence[T]]
) -> AsyncIterator[T]:
    """`items` for pages that are awaited."""
    after = None
    while True:
        page = await read(after)
        for item in of(page):
            yield item
        after = page.next
        if after is None:
            return


#: Where the service listens unless it is told otherwise.
DEFAULT_URL = "http://127.0.0.1:8000"


class Robots(RobotEndpoints, Group):
    """Robots: stored models, and what is computed of one of them."""

    def iterate(self) -> Iterator[RobotSummary]:
        """All robots by name, page after page."""
        return items(lambda after: self.list(after=after), lambda page: page.robots)


class AsyncRobots(RobotEndpoints, AsyncGroup):
    """`Robots` to be awaited."""

    def iterate(self) -> AsyncIterator[RobotSummary]:
        """All robots by name, page after page."""
        return items_async(lambda after: self.list(after=after), lambda page: page.robots)


class Scenes(SceneEndpoints, Group):
    """Scenes: stored obstacles, and projections onto them."""

    def iterate(self) -> Iterator[SceneSummary]:
        """All stored scenes by name, page after page."""
        return items(lambda after: self.list(after=after), lambda page: page.scenes)


class AsyncScenes(SceneEndpoints, AsyncGroup):
    """`Scenes` to be awaited."""

    def iterate(self) -> AsyncIterator[SceneSummary]:
        """All stored scenes by name, page after page."""
        return items_async(lambda after: self.list(after=after), lambda page: page.scenes)


class Tools(ToolEndpoints, Group):
    """Tools: what robots work with."""

    def iterate(self) -> Iterator[ToolSummary]:
        """All tools by name, page after page."""
        return items(lambda after: self.list(after=after), lambda page: page.tools)


class AsyncTools(ToolEndpoints, AsyncGroup):
    """`Tools` to be awaited."""

    def iterate(self) -> AsyncIterator[ToolSummary]:
        """All tools by name, page after page."""
        return items_async(lambda after: self.list(after=after), lambda page: page.tools)


class Jobs(JobEndpoints, Group):
    """Jobs: requests that are answered later."""

    def iterate(self, status: str | None = None) -> Iterator[Job]:
        """All jobs, newest first, page after page, perhaps only those of a status."""
        return items(lambda after: self.list(after=after, status=status), lambda page: page.jobs)

    def wait(self, job: str, timeout: float | None = None) -> Job:
        """A job once it has ended, whatever became of it.

        Args:
            job: Id of the job.
            timeout: How long to wait [s]; without end if left out.

        Raises:
            TransportTimeout: It has not ended in time; it still may.
        """
        return wait_until_ended(self._sender, job, timeout)


class AsyncJobs(JobEndpoints, AsyncGroup):
    """`Jobs` to be awaited."""

    def iterate(self, status: str | None = None) -> AsyncIterator[Job]:
        """All jobs, newest first, page after page, perhaps only those of a status."""
        return items_async(
            lambda after: self.list(after=after, status=status), lambda page: page.jobs
        )

    async def wait(self, job: str, timeout: float | None = None) -> Job:
        """A job once it has ended, whatever became of it; see `Jobs.wait`."""
        return await ended_async(self._sender, job, timeout)


class Plans(PlanEndpoints, Group):
    """Kept plans: what was asked with `keep`, with its answer or problem."""

    def iterate(self, robot: str | None = None) -> Iterator[KeptPlanSummary]:
        """All kept plans, newest first, page after page, perhaps only those of a robot."""
        return items(lambda after: self.list(after=after, robot=robot), lambda page: page.plans)


class AsyncPlans(PlanEndpoints, AsyncGroup):
    """`Plans` to be awaited."""

    def iterate(self, robot: str | None = None) -> AsyncIterator[KeptPlanSummary]:
        """All kept plans, newest first, page after page, perhaps only those of a robot."""
        return items_async(
            lambda after: self.list(after=after, robot=robot), lambda page: page.plans
        )


class LaterRobots(RobotEndpoints, LaterGroup):
    """`Robots` whose answers are asked for later."""


class AsyncLaterRobots(RobotEndpoints, AsyncLaterGroup):
    """`LaterRobots` to be awaited."""


class LaterScenes(SceneEndpoints, LaterGroup):
    """`Scenes` whose answers are asked for later."""


class AsyncLaterScenes(SceneEndpoints, AsyncLaterGroup):
    """`LaterScenes` to be awaited."""


class Later(ServiceEndpoints, LaterGroup):
    """The methods of a client that give a `Pending` at once and the answer when it is there."""

    def __init__(self, sender: Session) -> None:
        super().__init__(sender)
        self.robots = LaterRobots(sender)
        self.scenes = LaterScenes(sender)


class AsyncLater(ServiceEndpoints, AsyncLaterGroup):
    """`Later` to be awaited."""

    def __init__(self, sender: AsyncSession) -> None:
        super().__init__(sender)
        self.robots = AsyncLaterRobots(sender)
        self.scenes = AsyncLaterScenes(sender)


class Client(ServiceEndpoints, Group):
    """A service at a URL; threads may share it.

    Args:
        base_url: URL of the service, with a prefix if it has one.
        transport: Transport in place of the network, as in httpx: a proxy, certificates, an
            application.
        options: `token`, `timeout` and `retry`, see `ClientOptions`.

    Raises:
        InvalidArgument: The URL or the token is malformed.
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
        self.tools = Tools(self._session)
        self.jobs = Jobs(self._session)
        self.plans = Plans(self._session)
        self.later = Later(self._session)

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
        self.tools = AsyncTools(self._session)
        self.jobs = AsyncJobs(self._session)
        self.plans = AsyncPlans(self._session)
        self.later = AsyncLater(self._session)

    async def close(self) -> None:
        """Close all connections."""
        await self._session.close()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *exception: object) -> None:
        await self.close()
