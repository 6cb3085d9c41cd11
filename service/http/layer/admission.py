"""Admission: requests that would be too late are refused before anything of them is parsed.

Under overload most requests are refused, so a refusal must cost little: the path tells which task a
request is for, the mean duration of that task how long it takes.
"""

import asyncio
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from starlette.types import Scope

from service.access.authentication import client_of
from service.http.request_headers import FIELDS
from service.settings import Settings
from service.workers.state import QueueFull
from service.workers.supervisor import WorkerSupervisor

#: A timeout, wherever in a body it stands. The pattern is tried where its name was found, from the
#: end on: to search for it from the beginning takes twice as long, for the pattern thrice.
_TIMEOUT_NAME = b'"timeout"'
_TIMEOUT = re.compile(rb'"timeout"\s*:\s*(\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)')
#: Bodies up to this are read before their request is judged: nearly all came with its head [byte].
_SHORT_BYTES = 64 * 1024
#: Pause before a request is refused [s]. Whoever asks again at once is slowed down: refusals must
#: not use up what workers need.
_PAUSE = 0.02


class Admission:
    """Admission of requests that compute.

    Args:
        supervisor: Supervisor of the workers.
        settings: Settings with the timeout of a request that names none.
    """

    def __init__(self, supervisor: WorkerSupervisor, settings: Settings) -> None:
        self._supervisor = supervisor
        self._settings = settings
        self._tasks: dict[str, str] = {}
        self._turn = asyncio.Lock()

    def record_task(self, method: str, path: str, task: str) -> None:
        """Record the task of an endpoint by the last part of its path, for POST never a name."""
        if method == "POST":
            self._tasks[path.rpartition("/")[2]] = task

    async def check_announced(self, scope: Scope) -> None:
        """Check a request with a large body before that is read.

        Args:
            scope: Scope of the request.

        Raises:
            QueueFull: OVERLOADED, it would be too late whatever timeout it names.
        """
        announced = scope[FIELDS].get("content-length", "")
        size = int(announced) if announced.isdecimal() and len(announced) < 20 else 0
        if size <= _SHORT_BYTES:
            return
        try:
            await self._check(scope, self._settings.max_timeout, size)
        except QueueFull as problem:
            problem.headers["Connection"] = "close"
            raise

    @asynccontextmanager
    async def admitted(self, scope: Scope, content: bytes) -> AsyncIterator[None]:
        """Context of a request whose body has arrived, in which it counts as one that waits.

        Args:
            scope: Scope of the request.
            content: The body.

        Raises:
            QueueFull: It would be too late for the timeout that it names.
        """
        if self._task(scope) is None:
            yield
            return
        is_first = self._supervisor.is_free
        if not is_first:
            await self._check(scope, named_timeout(content, self._settings), len(content))
        client = client_of(scope)
        self._supervisor.in_flight.enter(client)
        try:
            if not is_first:
                # One in each turn of the event loop: to parse all of a crowd in one would hold up
                # everything else meanwhile, health and refusals and the work of free workers.
                async with self._turn:
                    await asyncio.sleep(0)
            yield
        finally:
            self._supervisor.in_flight.leave(client)

    async def _check(self, scope: Scope, seconds: float, size: int) -> None:
        task = self._task(scope)
        if task is None or self._supervisor.is_free:
            return
        problem = self._supervisor.early_refusal(task, seconds, client_of(scope), size)
        if problem is not None:
            await asyncio.sleep(_PAUSE)
            raise problem

    def _task(self, scope: Scope) -> str | None:
        """The task that a request is for, as far as known; None for one that becomes a job."""
        if scope["method"] != "POST" or "prefer" in scope[FIELDS]:
            return None
        return self._tasks.get(scope["path"].rpartition("/")[2])


def named_timeout(content: bytes, settings: Settings) -> float:
    """Time that a body names as its timeout, the longest one where there are several [s]."""
    named, place = list[float](), len(content)
    while (place := content.rfind(_TIMEOUT_NAME, 0, place)) >= 0:
        match = _TIMEOUT.match(content, place)
        if match is not None:
            named.append(float(match[1]))
    return min(max(named, default=settings.default_timeout), settings.max_timeout)
