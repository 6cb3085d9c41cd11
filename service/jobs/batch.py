"""Many problems as one job: each gets its answer or its problem, whatever becomes of the others."""

import asyncio
import math
import time
from collections.abc import Iterator

from fastapi import Request
from pydantic_core import to_json
from starlette.concurrency import run_in_threadpool

from kinematics.errors import ArmwrightError
from service.http import answers
from service.http.errors import document, from_domain
from service.http.job_context import JobContext
from service.http.plan_answer import plan_answer
from service.http.state import settings_of, supervisor_of
from service.jobs.storage_retry import STORAGE_RETRY
from service.problem import ProblemError, unexpected_fault
from service.storage import prepared_files
from service.storage.cache_key import Reference
from service.storage.database import StorageUnavailable
from service.task_references import split
from service.tasks.result import BatchItem
from service.workers.faults import ShuttingDown

#: The progress of a batch is told at most this often [s].
_REPORT_PERIOD = 0.05


class Batch:
    """A batch that is being planned.

    Args:
        count: Its problems.
        request: Their request.
        context: Of the job that it has become.
    """

    def __init__(self, count: int, request: Request, context: JobContext) -> None:
        self._request = request
        self._context = context
        self._settings = settings_of(request)
        self._scene: Reference | None = None
        self._items: tuple[BatchItem, ...] = ()
        self._results: list[bytes] = [b""] * count
        self._shares = [0.0] * count
        self._done = 0
        self._failed = 0
        self._reported = -math.inf
        self._next_report: asyncio.TimerHandle | None = None

    async def run(self) -> bytes:
        """The results in order, JSON.

        Raises:
            ProblemError: The scene of all problems is not valid; the service ends.
        """
        self._report()
        await self._split()
        waiting = iter(range(len(self._items)))
        try:
            # Each worker has one of them at most, so that other jobs get their turns.
            async with asyncio.TaskGroup() as group:
                for _ in range(min(supervisor_of(self._request).count, len(self._items))):
                    group.create_task(self._plan_items(waiting))
        except* ProblemError as errors:
            raise errors.exceptions[0] from None
        finally:
            self._report(at_once=True)
            if self._scene is not None:
                await run_in_threadpool(prepared_files.forget, self._scene)
        return self._answer()

    async def _split(self) -> None:
        """Have a worker take the request apart, and build a scene that all problems share."""
        folder, name = str(self._settings.prepared_dir), f"batch-{self._context.id}"
        content = await self._request.body()
        self._items, shared = await answers.build(self._request, split.job(content, folder, name))
        if shared is not None:
            self._scene = Reference("scene", name, shared, folder)

    async def _plan_items(self, waiting: Iterator[int]) -> None:
        for index in waiting:
            try:
                left = self._context.deadline - time.monotonic()
                async with asyncio.timeout(max(left, 0.0)):
                    self._results[index] = await self._plan_once_possible(index)
            except ShuttingDown:  # the whole batch is done again when the service is back
                raise
            except ProblemError as problem:
                self._note(index, problem)
            except ArmwrightError as error:
                self._note(index, from_domain(error))
            except TimeoutError:
                self._note(index, _timeout_problem(self._settings.job_deadline))
            except Exception:  # noqa: BLE001  (a mistake of ours costs this problem alone)
                self._note(index, unexpected_fault(f"problem {index} of job {self._context.id}"))
            self._done += 1
            self._shares[index] = 1.0
            self._report()

    async def _plan_once_possible(self, index: int) -> bytes:
        """The plan of a problem, tried again for as long as the storage can't be used."""
        while True:
            try:
                return await self._plan(index)
            except StorageUnavailable:
                await asyncio.sleep(STORAGE_RETRY)

    async def _plan(self, index: int) -> bytes:
        item = self._items[index]

        def on_progress(share: float, _stage: str) -> None:
            self._shares[index] = max(self._shares[index], min(share, 1.0))
            self._report()

        scene = self._scene if item.shared else None
        return await plan_answer(self._request, item, item.content, scene, on_progress)

    def _note(self, index: int, problem: ProblemError) -> None:
        self._failed += 1
        instance = f"{self._request.url.path}#/problems/{self._context.first + index}"
        self._results[index] = to_json(document(problem, instance))

    def _report(self, *, at_once: bool = False) -> None:
        """Tell the progress; not more often than anybody sees, and never too late by much."""
        late = self._reported + _REPORT_PERIOD - time.monotonic()
        if late > 0.0 and not at_once:
            if self._next_report is None:
                loop = asyncio.get_running_loop()
                self._next_report = loop.call_later(late, lambda: self._report(at_once=True))
            return
        if self._next_report is not None:
            self._next_report.cancel()
            self._next_report = None
        self._reported = time.monotonic()
        count = len(self._results)
        share = sum(self._shares) / count
        self._context.on_progress(share, f"{self._done} of {count} problems")

    def _answer(self) -> bytes:
        succeeded = len(self._results) - self._failed
        return b'{"results":[%s],"succeeded":%d,"failed":%d}' % (
            b",".join(self._results),
            succeeded,
            self._failed,
        )


def _timeout_problem(seconds: float) -> ProblemError:
    return ProblemError(
        "TIMED_OUT",
        f"the batch did not come so far within the {seconds:g} s that a job may take",
        stage="job",
        hint="Send fewer problems at once, or raise ARMWRIGHT_JOB_DEADLINE where the service runs.",
    )
