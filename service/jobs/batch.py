"""Many problems as one job: each gets its answer or its problem, whatever becomes of the others."""

import asyncio
import json
import math
import re
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from fastapi import Request
from pydantic_core import to_json
from starlette.concurrency import run_in_threadpool

from kinematics.errors import ArmwrightError
from service.http import answers
from service.http.compute import allowed_time
from service.http.errors import document, problem_of
from service.http.metrics import Metrics
from service.http.state import JobContext, settings_of, supervisor_of
from service.jobs.execution import BATCH_PATH, STORAGE_RETRY
from service.storage.caches import prepared_files
from service.storage.caches.cache_key import Reference
from service.storage.database import StorageUnavailable
from service.storage.stores.job_store import ChunkAnswer, JobAnswer
from service.task_references import plan, plan_part, split
from service.validation import ProblemError, unexpected_fault
from service.workers.chunk_sizes import TURN
from service.workers.result import BatchItem, PlannedPart, PlanOutcome, SplitBatch, TaskProblem
from service.workers.state import ShuttingDown

#: Problems of a part at most: quicker ones than half a millisecond there are not.
_LARGEST = 64
#: Size of the problems of a part at most, unless it is one alone [byte].
_BYTES = 256 * 1024
#: Parts that each worker gets of what is left: the last ones are small, so that all workers end at
#: about the same time.
_TURNS = 2
#: Problems of a part, by those that a worker plans in its turn: what it does not come to was sent
#: and validated in vain, and a part that is too short ends its turn early.
_SPARE = 1.5


@dataclass(frozen=True, slots=True)
class Part:
    """Problems of a batch for one worker.

    Args:
        indices: Indices of the problems in the batch, at least one.
        contents: Fields of each problem alone, JSON.
    """

    indices: Sequence[int]
    contents: Sequence[bytes]

    def request(self, head: bytes) -> bytes:
        """The part as a batch of its own, JSON.

        Args:
            head: The fields of the batch that stand beside its problems, each with a comma.
        """
        return b'{%s"problems":[%s]}' % (head, b",".join(self.contents))


class Parts:
    """The problems of a batch that wait.

    Args:
        items: All problems.
    """

    def __init__(self, items: Sequence[BatchItem]) -> None:
        self._items = items
        self._waiting = deque(range(len(items)))
        self._alone: set[int] = set()

    def take(self, workers: int, mean: float = 0.0) -> Part | None:
        """The next problems for one of some workers; None if none wait.

        They have the same robot, scene and timeout.

        Args:
            workers: Workers that share what is left.
            mean: Time of a problem, if it is known [s].
        """
        if not self._waiting:
            return None
        largest = min(_LARGEST, math.ceil(len(self._waiting) / (_TURNS * workers)))
        if mean > 0.0:
            largest = min(largest, math.ceil(_SPARE * TURN / mean))
        first = self._waiting.popleft()
        indices, size = [first], len(self._items[first].content)
        if first not in self._alone:
            while self._waiting and len(indices) < largest:
                index = self._waiting[0]
                size += len(self._items[index].content)
                if size > _BYTES or index in self._alone or not self._begin_alike(first, index):
                    break
                indices.append(self._waiting.popleft())
        return Part(indices, [self._items[index].content for index in indices])

    def put_back(self, indices: Sequence[int], *, alone: bool = False) -> None:
        """Have problems wait again, before all others.

        Args:
            indices: Indices in order.
            alone: Whether each is to be a part of its own from then on.
        """
        self._waiting.extendleft(reversed(indices))
        if alone:
            self._alone.update(indices)

    def _begin_alike(self, one: int, other: int) -> bool:
        first, second = self._items[one], self._items[other]
        return all(
            getattr(first, name) == getattr(second, name)
            for name in ("robot", "scene", "shared", "timeout", "mounted")
        )


#: The progress of a batch is told at most this often [s].
_REPORT_PERIOD = 0.05


class Batch:
    """A batch that is being planned.

    Args:
        request: The request for it.
        context: Context of the job that the request has become.
    """

    def __init__(self, request: Request, context: JobContext) -> None:
        self._request = request
        self._context = context
        self._settings = settings_of(request)
        self._supervisor = supervisor_of(request)
        self._metrics: Metrics = request.app.state.metrics
        self._batch = SplitBatch((), b"", None)
        self._scene: Reference | None = None
        self._parts = Parts(())
        self._results: list[bytes] = []
        self._shares: list[float] = []
        self._done = 0
        self._failed = 0
        self._mean = 0.0
        self._reported = -math.inf
        self._next_report: asyncio.TimerHandle | None = None

    async def run(self) -> bytes:
        """The results in order, JSON.

        Raises:
            ProblemError: The scene of all problems is not valid; the service ends.
        """
        await self._split()
        self._report()
        try:
            # Each worker has one part at most, so that other jobs get their turns.
            async with asyncio.TaskGroup() as group:
                for _ in range(min(self._supervisor.count, len(self._results))):
                    group.create_task(self._plan_parts())
        except* ProblemError as errors:
            raise errors.exceptions[0] from None
        finally:
            self._report(at_once=True)
            if self._scene is not None:
                await run_in_threadpool(prepared_files.forget, self._scene)
        return self._answer()

    async def _split(self) -> None:
        """Have a worker take the request apart, and build a scene that all problems share."""
        folder, name = self._settings.prepared_dir, f"batch-{self._context.id}"
        content = await self._request.body()
        self._batch = await answers.build(self._request, split.job(content, folder, name))
        if self._batch.scene_hash is not None:
            self._scene = Reference("scene", name, self._batch.scene_hash, folder)
        count = len(self._batch.items)
        self._parts = Parts(self._batch.items)
        self._results, self._shares = [b""] * count, [0.0] * count

    async def _plan_parts(self) -> None:
        while part := self._parts.take(self._supervisor.count, self._mean):
            try:
                left = self._context.deadline - time.monotonic()
                async with asyncio.timeout(max(left, 0.0)):
                    planned = await self._plan_once_possible(part)
            except ShuttingDown:  # the whole batch is done again when the service is back
                raise
            except TimeoutError:
                for index in part.indices:
                    self._note_problem(index, _timeout_problem(self._settings.job_deadline))
            except Exception as error:  # noqa: BLE001  (it costs the problem alone whose it is)
                self._note_fault(part, error)
            else:
                self._note(part, planned)
                continue
            self._report()

    async def _plan_once_possible(self, part: Part) -> PlannedPart:
        """The plans of a part, tried again for as long as the storage can't be used."""
        while True:
            try:
                return await self._plan(part)
            except StorageUnavailable:
                await asyncio.sleep(STORAGE_RETRY)

    async def _plan(self, part: Part) -> PlannedPart:
        first = part.indices[0]
        item = self._batch.items[first]
        scene = self._scene if item.shared else None
        seconds = allowed_time(self._settings, item.timeout)
        content = part.request(self._batch.head)

        def on_progress(done: float, _stage: str) -> None:
            # So many problems are done, and the share of the next one.
            count = min(int(done), len(part.indices) - 1)
            for index in part.indices[:count]:
                self._shares[index] = 1.0
            index = part.indices[count]
            self._shares[index] = max(self._shares[index], min(done - count, 1.0))
            self._report()

        return await answers.answer(
            self._request,
            lambda robot, stored: plan_part.job(robot, scene or stored, content, seconds),
            item.robot,
            item.scene,
            timeout=item.timeout,
            on_progress=on_progress,
            asked=item.mounted,
        )

    # ------------------------------------------------------------------------------ outcomes

    def _note(self, part: Part, planned: PlannedPart) -> None:
        """Note what became of the first problems of a part; the others wait again."""
        count = len(planned.outcomes)
        self._mean = planned.seconds / count
        self._supervisor.durations.note(plan.name, self._mean)
        self._parts.put_back(part.indices[count:])
        for index, outcome in zip(part.indices, planned.outcomes, strict=False):
            self._note_outcome(index, outcome)
        self._report()

    def _note_outcome(self, index: int, outcome: PlanOutcome | TaskProblem) -> None:
        if isinstance(outcome, PlanOutcome):
            self._metrics.count_plan(outcome.planner, outcome.stages)
            self._end(index, outcome.content)
        else:
            self._note_problem(index, outcome.error)

    def _note_fault(self, part: Part, error: Exception) -> None:
        """Note the fault of a problem; those of a part are tried alone, to learn whose it is."""
        if len(part.indices) > 1:
            self._parts.put_back(part.indices, alone=True)
            return
        index = part.indices[0]
        if isinstance(error, ProblemError | ArmwrightError):
            self._note_problem(index, problem_of(error))
        else:
            mishap = unexpected_fault(f"problem {index} of job {self._context.id}")
            self._note_problem(index, mishap)

    def _note_problem(self, index: int, problem: ProblemError) -> None:
        self._metrics.count_failure(problem.code, problem.details.get("stages"))
        self._failed += 1
        instance = f"{self._request.url.path}#/problems/{self._context.first + index}"
        self._end(index, to_json(document(problem, instance)))

    def _end(self, index: int, result: bytes) -> None:
        self._results[index] = result
        self._shares[index] = 1.0
        self._done += 1

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


_JSON = "application/json"
_HEAD = b'{"results":['
_TAIL = re.compile(rb'\],"succeeded":(\d+),"failed":(\d+)\}\Z')


def joined_answer(chunks: Sequence[ChunkAnswer]) -> JobAnswer:
    """The answer to a batch, as if it had been answered as a whole.

    The results of a chunk go in as they are, without being parsed. Where a chunk as a whole has
    failed, each of its problems has.

    Args:
        chunks: The answers to its chunks, in order.
    """
    results, succeeded, failed = [], 0, 0
    for chunk in chunks:
        if chunk.has_succeeded:
            tail = _TAIL.search(chunk.content, max(len(chunk.content) - 80, 0))
            assert tail is not None
            results.append(chunk.content[len(_HEAD) : tail.start()])
            succeeded += int(tail[1])
            failed += int(tail[2])
        else:
            results.append(_failures(chunk))
            failed += chunk.size
    content = b'%s%s],"succeeded":%d,"failed":%d}'
    return JobAnswer(_JSON, content % (_HEAD, b",".join(results), succeeded, failed))


def _failures(chunk: ChunkAnswer) -> bytes:
    """The problem of a chunk, once for each of its problems."""
    problem = json.loads(chunk.content)
    indices = range(chunk.first, chunk.first + chunk.size)
    return b",".join(
        to_json(problem | {"instance": f"{BATCH_PATH}#/problems/{index}"}) for index in indices
    )
