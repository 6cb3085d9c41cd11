"""Handles of jobs that know the type of their results."""

import asyncio
import time
from collections.abc import AsyncIterator, Iterator
from typing import Generic, Protocol, TypeVar

from pydantic_core import to_json

from armwright_client.call import Call, EventCall, path, read_nothing
from armwright_client.errors import TransportTimeout, from_problem
from armwright_client.job import Job, JobEvent
from armwright_wire.errors import ArmwrightError
from armwright_wire.plans.job import Problem

A = TypeVar("A")

#: First pause between two requests for a job's status [s].
_FIRST_PAUSE = 0.02
#: Longest pause between two requests for a job's status [s].
_MAX_PAUSE = 1.0
#: Ratio of one pause to the one before.
_PAUSE_GROWTH = 1.5
#: HTTP status of the error of a cancelled job, which has no problem document of its own.
_CANCELLED = 409


class _Sender(Protocol):
    def send(self, call: Call[A]) -> A: ...
    def stream(self, call: EventCall) -> Iterator[JobEvent]: ...


class _AsyncSender(Protocol):
    async def send(self, call: Call[A]) -> A: ...
    def stream(self, call: EventCall) -> AsyncIterator[JobEvent]: ...


class Pending(Generic[A]):
    """The answer to a request that was accepted as a job.

    Args:
        sender: Of the client.
        job: As it was accepted.
        call: The request, which knows how to read its answer.
    """

    def __init__(self, sender: _Sender, job: Job, call: Call[A]) -> None:
        self._sender = sender
        self._call = call
        self.id = job.id

    def job(self) -> Job:
        """Status of the job."""
        return self._sender.send(job_call(self.id))

    def wait(self, timeout: float | None = None) -> A:
        """The answer, once it is there.

        Args:
            timeout: How long to wait [s]; without end if left out.

        Raises:
            ApiError: The job failed; `Preempted` if it was cancelled.
            TransportTimeout: It did not end in time; it still may.
        """
        return answer_of(wait_until_ended(self._sender, self.id, timeout), self._call)

    def events(self, *, after: str | None = None) -> Iterator[JobEvent]:
        """The events of the job until it ends, from the beginning or after one that was seen."""
        return self._sender.stream(events_call(self.id, after))

    def cancel(self) -> Job:
        """End the job."""
        return self._sender.send(cancel_call(self.id))


class AsyncPending(Generic[A]):
    """`Pending` to be awaited."""

    def __init__(self, sender: _AsyncSender, job: Job, call: Call[A]) -> None:
        self._sender = sender
        self._call = call
        self.id = job.id

    async def job(self) -> Job:
        """Status of the job."""
        return await self._sender.send(job_call(self.id))

    async def wait(self, timeout: float | None = None) -> A:
        """The answer, once it is there; see `Pending.wait`."""
        return answer_of(await ended_async(self._sender, self.id, timeout), self._call)

    def events(self, *, after: str | None = None) -> AsyncIterator[JobEvent]:
        """The events of the job until it ends, from the beginning or after one that was seen."""
        return self._sender.stream(events_call(self.id, after))

    async def cancel(self) -> Job:
        """End the job."""
        return await self._sender.send(cancel_call(self.id))


def job_call(job: str) -> Call[Job]:
    """The request for where a job stands."""
    return Call("GET", path("jobs", job), Job.read)


def cancel_call(job: str) -> Call[Job]:
    """The request to end a job."""
    return Call("DELETE", path("jobs", job), Job.read)


def events_call(job: str, after: str | None) -> EventCall:
    """The request for the events of a job."""
    headers = {} if after is None else {"Last-Event-ID": after}
    return EventCall("GET", path("jobs", job, "events"), read_nothing, headers=headers)


def wait_until_ended(sender: _Sender, job: str, timeout: float | None) -> Job:
    """Look at a job until it has ended.

    Raises:
        TransportTimeout: It has not in time.
    """
    pause, end = _FIRST_PAUSE, _end(timeout)
    while not (status := sender.send(job_call(job))).done:
        time.sleep(_next_pause(job, pause, end))
        pause = min(pause * _PAUSE_GROWTH, _MAX_PAUSE)
    return status


async def ended_async(sender: _AsyncSender, job: str, timeout: float | None) -> Job:
    """`wait_until_ended` to be awaited."""
    pause, end = _FIRST_PAUSE, _end(timeout)
    while not (status := await sender.send(job_call(job))).done:
        await asyncio.sleep(_next_pause(job, pause, end))
        pause = min(pause * _PAUSE_GROWTH, _MAX_PAUSE)
    return status


def _end(timeout: float | None) -> float | None:
    return None if timeout is None else time.monotonic() + timeout


def _next_pause(job: str, pause: float, end: float | None) -> float:
    if end is None:
        return pause
    left = end - time.monotonic()
    if left <= 0.0:
        raise TransportTimeout(f"job {job} has not ended in time; it goes on")
    return min(pause, left)


def answer_of(job: Job, call: Call[A]) -> A:
    """The answer to the request of a job that has ended.

    Raises:
        ApiError: It failed or was cancelled.
    """
    if job.status == "succeeded":
        return call.read(to_json(job.result))
    raise _failure(job)


def _failure(job: Job) -> ArmwrightError:
    problem = job.error
    if problem is None:
        detail = f"job {job.id} was {job.status}"
        problem = Problem(status=_CANCELLED, code="PREEMPTED", detail=detail)
    return from_problem(problem, problem.status or 500)
