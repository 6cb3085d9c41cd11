"""The pool of worker processes: whoever dies is replaced."""

import asyncio
import contextlib
import logging
import multiprocessing
import socket
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from service.workers import main
from service.workers.main import Reply
from service.workers.process import Worker, in_thread, reap, start

_log = logging.getLogger(__name__)

#: Pause after the first failed start of a worker [s]; each further one is twice as long.
_FIRST_PAUSE = 0.01
#: Longest pause between failed starts of a worker [s].
_LONGEST_PAUSE = 1.0
#: A worker may be killed while it starts; only several in a row mean that none can start.
_FAILURES = 3


class Owner(Protocol):
    """Owner of a pool, told what happens to its workers."""

    def worker_ready(self, worker: Worker) -> None:
        """A worker is warm and waits for its first job."""

    def message_received(self, worker: Worker, kind: Reply, values: Sequence[Any]) -> None:
        """A worker sent something about its job."""

    async def worker_lost(self, worker: Worker) -> None:
        """A worker has ended; it is not reaped yet."""


class WorkerPool:
    """A fixed number of worker processes that are kept alive.

    Args:
        count: How many.
        owner: Who is told of what happens to them.
        modules: Packages and modules whose tasks may be called.
        warm: Called by each worker before it counts as ready; picklable.
        preload: Modules that the fork server loads once for all workers.
    """

    def __init__(
        self,
        count: int,
        owner: Owner,
        modules: Sequence[str],
        warm: Callable[[], object],
        preload: Sequence[str],
    ) -> None:
        self.count = count
        self.workers: set[Worker] = set()
        self.started = 0
        self._owner = owner
        self._modules = tuple(modules)
        self._warm = warm
        self._preload = list(preload)
        self._supervisors: list[asyncio.Task[None]] = []
        self._warmed: set[int] = set()
        self._failing: set[int] = set()
        self._context = multiprocessing.get_context("forkserver")
        self._starting = asyncio.Lock()

    @property
    def ready(self) -> bool:
        """Whether every worker has been warm once and none fails to start."""
        return len(self._warmed) == self.count and not self._failing

    @property
    def pids(self) -> list[int]:
        """The process numbers of the workers that live; those being reaped are gone already."""
        return [
            worker.process.pid
            for worker in self.workers
            if worker.process.pid is not None and not worker.ending
        ]

    def start(self) -> None:
        """Start the workers, without waiting until they are ready."""
        self._context.set_forkserver_preload(self._preload)
        self._supervisors = [
            asyncio.create_task(self._supervise(slot)) for slot in range(self.count)
        ]

    async def stop(self) -> None:
        """End the workers."""
        for supervisor in self._supervisors:
            supervisor.cancel()
        await asyncio.gather(*self._supervisors, return_exceptions=True)
        workers = list(self.workers)
        for worker in workers:
            worker.kill()
        await asyncio.gather(*(in_thread(reap, worker.process) for worker in workers))
        self.workers.clear()

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
                    await in_thread(reap, worker.process)
                    worker.ticket = None
                    self.workers.discard(worker)
            except Exception:  # noqa: BLE001  (whatever it is, the next attempt may succeed)
                _log.exception("a worker could not be started or reaped")
            failures = 0 if was_warm else failures + 1
            if failures >= _FAILURES:
                self._failing.add(slot)
            if failures:
                await asyncio.sleep(min(_FIRST_PAUSE * 2.0**failures, _LONGEST_PAUSE))

    async def _spawn(self, slot: int) -> Worker:
        # One after the other, and no sockets for those that wait: waiting can be cancelled.
        async with self._starting:
            ours, theirs = socket.socketpair()
            with contextlib.ExitStack() as on_failure:
                on_failure.callback(ours.close)
                process = self._context.Process(
                    target=main.main,
                    args=(theirs, self._modules, self._warm),
                    name=f"armwright-worker-{slot}",
                    daemon=True,
                )
                await in_thread(start, process, theirs)
                ours.setblocking(False)
                loop = asyncio.get_running_loop()
                _, worker = await loop.create_unix_connection(
                    lambda: Worker(process, lambda *sent: self._receive(slot, *sent)), sock=ours
                )
                on_failure.pop_all()
        self.started += 1
        self.workers.add(worker)
        return worker

    def _receive(self, slot: int, worker: Worker, message: tuple[Any, ...]) -> None:
        kind, *values = message
        if kind == Reply.READY:
            self._warmed.add(slot)
            self._failing.discard(slot)
            worker.warm = True
            self._owner.worker_ready(worker)
        elif kind == Reply.UNFIT:
            _log.error("a worker could not warm up:\n%s", values[0])
        else:
            self._owner.message_received(worker, Reply(kind), values)
