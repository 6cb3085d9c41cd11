"""The pool of worker processes: whoever dies is replaced."""

import asyncio
import contextlib
import logging
import math
import socket
import time
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

from service.workers.fork.client import ForkServer, ForkServerLost
from service.workers.fork.launch import Launched, Recipe, launch
from service.workers.fork.server import Notice
from service.workers.main import Reply
from service.workers.process import (
    DEFAULT_LIMITS,
    EXIT_TIMEOUT,
    Memory,
    Worker,
    WorkerLimits,
    limit_memory,
)

_log = logging.getLogger(__name__)

_REPLIES = {reply.value: reply for reply in Reply}

#: Pause after the first failed start of a worker [s]; each further one is twice as long.
_FIRST_PAUSE = 0.01
#: Longest pause between failed starts of a worker [s].
_LONGEST_PAUSE = 1.0
#: Pause before a fork server is started in place of one that has ended [s]: loading takes as long.
_FORK_SERVER_PAUSE = 1.0
#: A worker may be killed while it starts; only several in a row mean that none can start.
_FAILURES = 3
#: How often the log says how far preparing has come [s].
_LOG_PERIOD = 5.0
#: Time in which a worker is replaced [s]: without one for longer, the service is not ready.
_REPLACEMENT_TIME = 0.5
#: How often workers that are to be renewed are looked at [s].
_RENEWAL_PERIOD = 0.05


class Progress(NamedTuple):
    """Progress of the preparation.

    Attributes:
        done: Kernels that are compiled.
        total: Kernels that there are to compile.
        remaining: How long the rest may take [s]; None if that is not known yet.
    """

    done: int
    total: int
    remaining: float | None


class Owner(Protocol):
    """Owner of a pool, told what happens to its workers."""

    def worker_ready(self, worker: Worker) -> None:
        """A worker is warm and waits for its first job."""

    def message_received(self, worker: Worker, kind: Reply, values: Sequence[Any]) -> None:
        """A worker sent something about its job."""

    async def worker_lost(self, worker: Worker) -> None:
        """A worker has ended; its exit code may not be known yet."""

    def retire(self, worker: Worker) -> bool:
        """Give a worker no more jobs; False if it has one."""


class WorkerPool:
    """A fixed number of worker processes that are kept alive, and the fork server that forks them.

    Args:
        count: How many.
        owner: Owner that is called when something happens to workers.
        recipe: Recipe of what the fork server loads.
        launched: A fork server with this recipe that was started already.
        limits: Limits of each worker.
    """

    def __init__(
        self,
        count: int,
        owner: Owner,
        recipe: Recipe,
        launched: Launched | None = None,
        limits: WorkerLimits = DEFAULT_LIMITS,
    ) -> None:
        self.count = count
        self.workers: set[Worker] = set()
        self.started = 0
        self.progress: Progress | None = None
        self._owner = owner
        self._recipe = recipe
        self._launched = launched
        self._limits = limits
        self._fork_server: ForkServer | None = None
        self._twin: ForkServer | None = None
        self._enriched = asyncio.Event()
        self._lost: list[ForkServer] = []
        self._available = asyncio.Event()
        self._unfit = self._renewed = False
        self._tasks: set[asyncio.Task[None]] = set()
        self._warmed: set[int] = set()
        self._failing: set[int] = set()
        self._began = time.monotonic()
        self._logged = 0.0
        self._last_worked = -math.inf

    @property
    def ready(self) -> bool:
        """Whether every worker has been warm once, none fails to start and one can work now."""
        works = any(worker.warm and not worker.ending for worker in self.workers)
        if works:
            self._last_worked = time.monotonic()
        elif time.monotonic() - self._last_worked > _REPLACEMENT_TIME:
            return False
        return len(self._warmed) == self.count and not self._failing and not self._unfit

    @property
    def unfit(self) -> bool:
        """Whether the fork server could not prepare what workers need."""
        return self._unfit

    @property
    def settled(self) -> bool:
        """Whether no worker is to be replaced by one that has more prepared."""
        return self._renewed or self._recipe.enrich is None

    @property
    def pids(self) -> list[int]:
        """The process numbers of the workers that live; those being reaped are gone already."""
        return [worker.process.pid for worker in self.workers if not worker.ending]

    def start(self) -> None:
        """Start the workers, without waiting until they are ready."""
        self._began = time.monotonic()
        self._task(self._keep_fork_server())
        self._task(self._keep_twin())
        for slot in range(self.count):
            self._task(self._supervise(slot))

    async def stop(self) -> None:
        """End the workers and the fork server."""
        workers = list(self.workers)
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for worker in {*workers, *self.workers}:
            worker.kill()
        await asyncio.gather(*(one.process.exit_code(EXIT_TIMEOUT) for one in workers))
        for fork_server in (self._twin, *self._lost, self._fork_server):
            if fork_server is not None:
                await fork_server.end()
        if self._launched is not None:
            await asyncio.to_thread(self._launched.end)
        self._fork_server = self._twin = self._launched = None
        self.workers.clear()

    def _task(self, work: Any) -> None:
        task: asyncio.Task[None] = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    # ------------------------------------------------------------------------- the fork server

    async def _keep_fork_server(self) -> None:
        """Keep a fork server alive, for ever; workers outlive it, and so does its twin."""
        while True:
            try:
                self._fork_server = self._next_in_line()
                self._available.set()
                await self._fork_server.lost.wait()
                self._available.clear()
                lost, self._fork_server = self._fork_server, None
                if lost.holds_workers:
                    self._lost.append(lost)
                await lost.reap()
                _log.warning("the fork server has ended; another takes its place")
            except Exception:  # noqa: BLE001  (whatever it is, the next attempt may succeed)
                _log.exception("the fork server could not be started")
            if self._twin is None:
                await asyncio.sleep(_FORK_SERVER_PAUSE)

    def _next_in_line(self) -> ForkServer:
        """The twin of the fork server that has ended, or a new one, which has to load first."""
        twin, self._twin = self._twin, None
        if twin is not None and not twin.lost.is_set():
            return twin
        launched, self._launched = self._launched or launch(self._recipe), None
        return ForkServer(launched, self._noticed)

    async def _keep_twin(self) -> None:
        """Keep a fork server that waits to take the place of the one in use, for ever."""
        while True:
            with contextlib.suppress(ForkServerLost):
                fork_server = await self._next_fork_server()
                self._enriched.clear()
                self._twin = twin = await fork_server.fork_twin(self._noticed_by_twin)
                events = (twin.lost, fork_server.lost, self._enriched)
                waiting = [asyncio.ensure_future(event.wait()) for event in events]
                try:
                    await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
                finally:
                    for future in waiting:
                        future.cancel()
                if not fork_server.lost.is_set():  # else it takes over
                    self._twin = None
                    await twin.reap()
            await asyncio.sleep(_FIRST_PAUSE)

    def _noticed_by_twin(self, kind: Notice, values: Sequence[Any]) -> None:
        if self._twin is None and kind != Notice.WARM:  # it has taken over
            self._noticed(kind, values)

    def _noticed(self, kind: Notice, values: Sequence[Any]) -> None:
        if kind == Notice.PROGRESS:
            self.progress = Progress(*values)
            self._log_progress(self.progress)
        elif kind == Notice.UNFIT:
            self._unfit = True
            _log.error("the workers could not warm up:\n%s", values[0])
        elif kind == Notice.WARM:
            self.progress, self._unfit = None, False
        elif kind == Notice.ENRICHED:
            self._enriched.set()
            self._task(self._renew())

    def _log_progress(self, progress: Progress) -> None:
        ends = progress.done == progress.total
        if not ends and time.monotonic() < self._logged + _LOG_PERIOD:
            return
        self._logged = time.monotonic()
        left = ""
        if progress.remaining is not None and not ends:
            left = f", about {progress.remaining:.0f} s left"
        _log.info("compiling kernels: %d of %d%s", progress.done, progress.total, left)

    async def _renew(self) -> None:
        """Have workers that were forked early replaced, one at a time and each when it is idle."""
        outdated = set(self.workers)
        while outdated := {worker for worker in outdated if not worker.ending}:
            if len(self.pids) == self.count and all(worker.warm for worker in self.workers):
                next(filter(self._owner.retire, outdated), None)
            await asyncio.sleep(_RENEWAL_PERIOD)
        self._renewed = True

    # ----------------------------------------------------------------------------- the workers

    async def _supervise(self, slot: int) -> None:
        """Keep one worker alive, for ever."""
        failures = 0
        while True:
            was_warm = False
            try:
                worker = await self._spawn(slot)
                try:
                    await worker.gone.wait()
                finally:
                    was_warm = worker.warm
                    worker.kill()  # its stream may have ended before the process did
                    await self._owner.worker_lost(worker)
                    worker.ticket = None
                    self.workers.discard(worker)
                    if was_warm:
                        self._last_worked = max(self._last_worked, worker.lost_at)
            except ForkServerLost:
                continue
            except Exception:  # noqa: BLE001  (whatever it is, the next attempt may succeed)
                _log.exception("a worker could not be started or reaped")
            failures = 0 if was_warm else failures + 1
            if failures >= _FAILURES:
                self._failing.add(slot)
            if failures:
                await asyncio.sleep(min(_FIRST_PAUSE * 2.0**failures, _LONGEST_PAUSE))

    async def _spawn(self, slot: int) -> Worker:
        fork_server = await self._next_fork_server()
        ours, theirs = socket.socketpair()
        with contextlib.ExitStack() as on_failure:
            on_failure.callback(ours.close)
            process = await fork_server.fork(theirs)
            on_failure.callback(process.kill)
            limit_memory(process.pid, self._limits)
            ours.setblocking(False)
            loop = asyncio.get_running_loop()
            _, worker = await loop.create_unix_connection(
                lambda: Worker(process, lambda *sent: self._receive(slot, *sent)), sock=ours
            )
            on_failure.pop_all()
        self.started += 1
        self.workers.add(worker)
        return worker

    async def _next_fork_server(self) -> ForkServer:
        while True:
            await self._available.wait()
            if self._fork_server is not None and not self._fork_server.lost.is_set():
                return self._fork_server
            await asyncio.sleep(_FIRST_PAUSE)

    def _receive(self, slot: int, worker: Worker, message: tuple[Any, ...]) -> None:
        kind, *values = message
        if kind == Reply.READY:
            self._failing.discard(slot)
            worker.warm = True
            worker.resident_at_first = Memory.of(worker.process.pid).resident
            if slot not in self._warmed:
                self._warmed.add(slot)
                if self.ready:
                    seconds = time.monotonic() - self._began
                    _log.info("%d workers are ready after %.1f s", self.count, seconds)
            self._owner.worker_ready(worker)
            if self.ready and self._fork_server is not None:
                self._fork_server.enrich()
        else:
            self._owner.message_received(worker, _REPLIES[kind], values)
