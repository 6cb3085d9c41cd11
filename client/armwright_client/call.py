"""Requests as values, methods that are made of them, and handles of jobs that answer later.

A method is written once, as a function from its arguments to a `Call`. `Endpoint` makes of it a
method that answers where the client is synchronous, and one to be awaited where it is not.
"""

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, lru_cache, wraps
from inspect import Signature, signature
from types import MethodType
from typing import (
    Any,
    Concatenate,
    Generic,
    ParamSpec,
    Protocol,
    TypeVar,
    get_args,
    overload,
)
from urllib.parse import quote

from pydantic import ValidationError
from pydantic_core import to_json

from armwright_client.errors import TransportTimeout, from_problem
from armwright_client.job import Job, JobEvent
from armwright_client.robots.robot import RobotArchive
from armwright_wire.base import Body
from armwright_wire.errors import ArmwrightError, InvalidArgument
from armwright_wire.plans.job import Problem

P = ParamSpec("P")
A = TypeVar("A")

#: First pause between two requests for a job's status [s].
_FIRST_PAUSE = 0.02
#: Longest pause between two requests for a job's status [s].
_MAX_PAUSE = 1.0
#: Ratio of one pause to the one before.
_PAUSE_GROWTH = 1.5
#: HTTP status of the error of a cancelled job, which has no problem document of its own.
_CANCELLED = 409
#: Errors of arguments that one message shows.
_MAX_ERRORS = 3
#: Paths that are kept: most requests are about a few robots and scenes.
_KEPT_PATHS = 256


@dataclass(frozen=True, slots=True)
class Call(Generic[A]):
    """One request.

    Args:
        method: Method of HTTP.
        path: Path below the base URL.
        read: Makes the answer of its body.
        body: Body to be sent, a request as JSON.
        query: Parameters of the URL.
        key: Key for the header Idempotency-Key.
        headers: More of them.
        deadline: How long the service may take [s], where that is known.
        repeatable: Whether doing it twice does the same; with a key it always is.
    """

    method: str
    path: str
    read: Callable[[bytes], A]
    body: Body | RobotArchive | None = None
    query: Mapping[str, str | int | float] = field(default_factory=dict)
    key: str | None = None
    headers: Mapping[str, str] = field(default_factory=dict)
    deadline: float | None = None
    repeatable: bool = True


@dataclass(frozen=True, slots=True)
class EventCall(Call[None]):
    """A request that is answered by a stream of events."""


class Sender(Protocol):
    """Sends calls and waits for their answers."""

    def send(self, call: Call[A]) -> A:
        """The answer."""

    def postpone(self, call: Call[A]) -> "Pending[A]":
        """The handle of the job that will have the answer."""

    def stream(self, call: EventCall) -> Iterator[JobEvent]:
        """The events, as they come."""


class AsyncSender(Protocol):
    """Sends calls and awaits their answers."""

    async def send(self, call: Call[A]) -> A:
        """The answer."""

    async def postpone(self, call: Call[A]) -> "AsyncPending[A]":
        """The handle of the job that will have the answer."""

    def stream(self, call: EventCall) -> AsyncIterator[JobEvent]:
        """The events, as they come."""


class Group:
    """Methods that are sent by the same sender."""

    def __init__(self, sender: Sender) -> None:
        self._sender = sender


class AsyncGroup:
    """Methods to be awaited that are sent by the same sender."""

    def __init__(self, sender: AsyncSender) -> None:
        self._sender = sender


class LaterGroup(Group):
    """Methods whose requests become jobs."""


class AsyncLaterGroup(AsyncGroup):
    """Methods to be awaited whose requests become jobs."""


class _Builder(Generic[P, A]):
    def __init__(self, build: Callable[Concatenate[Any, P], Call[A]]) -> None:
        self._build = build
        self.__doc__ = build.__doc__


class Endpoint(_Builder[P, A]):
    """Method of a client, made of a function that gives a `Call`.

    Raises:
        InvalidArgument: When the method is called with arguments that are refused.
    """

    @overload
    def __get__(self, group: None, kind: type) -> Callable[..., Any]: ...
    @overload
    def __get__(self, group: LaterGroup, kind: type) -> Callable[P, "Pending[A]"]: ...
    @overload
    def __get__(
        self, group: AsyncLaterGroup, kind: type
    ) -> Callable[P, Awaitable["AsyncPending[A]"]]: ...
    @overload
    def __get__(self, group: Group, kind: type) -> Callable[P, A]: ...
    @overload
    def __get__(self, group: AsyncGroup, kind: type) -> Callable[P, Awaitable[A]]: ...
    def __get__(self, group: Group | AsyncGroup | None, kind: type) -> Any:
        later = issubclass(kind, LaterGroup | AsyncLaterGroup)
        return _bind(self._build, group, kind, "postpone" if later else "send")


class JobEndpoint(_Builder[P, A]):
    """Method whose request always becomes a job, made of a function that gives a `Call`."""

    @overload
    def __get__(self, group: None, kind: type) -> Callable[..., Any]: ...
    @overload
    def __get__(self, group: Group, kind: type) -> Callable[P, "Pending[A]"]: ...
    @overload
    def __get__(
        self, group: AsyncGroup, kind: type
    ) -> Callable[P, Awaitable["AsyncPending[A]"]]: ...
    def __get__(self, group: Group | AsyncGroup | None, kind: type) -> Any:
        return _bind(self._build, group, kind, "postpone")


class EventEndpoint(_Builder[P, None]):
    """Method that iterates over events, made of a function that gives an `EventCall`."""

    @overload
    def __get__(self, group: None, kind: type) -> Callable[..., Any]: ...
    @overload
    def __get__(self, group: Group, kind: type) -> Callable[P, Iterator[JobEvent]]: ...
    @overload
    def __get__(self, group: AsyncGroup, kind: type) -> Callable[P, AsyncIterator[JobEvent]]: ...
    def __get__(self, group: Group | AsyncGroup | None, kind: type) -> Any:
        return _bind(self._build, group, kind, "stream")


def _bind(build: Callable[..., Any], group: Any, kind: type, action: str) -> Any:
    """The method of a group, or of its class where there is no group."""
    method = _method(build, action, issubclass(kind, AsyncGroup))
    return method if group is None else MethodType(method, group)


@cache
def _method(build: Callable[..., Any], action: str, awaited: bool) -> Callable[..., Any]:
    """The method of all groups of a kind: made once, as to make it takes as long as to run it."""

    @wraps(build)
    def method(group: Any, *args: Any, **kwargs: Any) -> Any:
        try:
            call = build(group, *args, **kwargs)
        except ValidationError as error:
            raise InvalidArgument(refusal(error)) from error
        return getattr(group._sender, action)(call)

    method.__signature__ = _signature(build, awaited, action)  # type: ignore[attr-defined]
    return method


def _signature(build: Callable[..., Any], awaited: bool, action: str) -> Signature:
    """The signature that users see: what comes back, not the call that is sent."""
    shown = signature(build)
    answer = next(iter(get_args(shown.return_annotation)), None)
    if action == "stream":
        answer = AsyncIterator[JobEvent] if awaited else Iterator[JobEvent]
    elif action == "postpone":
        answer = Awaitable[AsyncPending[answer]] if awaited else Pending[answer]  # type: ignore[valid-type]
    elif awaited:
        answer = Awaitable[answer]  # type: ignore[valid-type]
    return shown.replace(return_annotation=answer)


def refusal(error: ValidationError) -> str:
    """The faults of a request that does not follow its model, in a sentence."""
    errors = error.errors(include_url=False, include_input=False, include_context=False)
    shown = errors[:_MAX_ERRORS]
    sentences = [f"{'.'.join(str(step) for step in e['loc'])}: {e['msg']}" for e in shown]
    more = [f"and {len(errors) - len(shown)} more"] if len(errors) > len(shown) else []
    return f"{error.title}: {'; '.join([*sentences, *more])}"


@lru_cache(_KEPT_PATHS)
def path(*segments: str) -> str:
    """A path of the interface; names in it are quoted.

    Raises:
        InvalidArgument: A name is empty, or a dot or two, which would be another path.
    """
    for segment in segments:
        if segment in ("", ".", ".."):
            raise InvalidArgument(f"{segment!r} can't be a name")
    return "/v1/" + "/".join(quote(segment, safe="") for segment in segments)


def read_nothing(content: bytes) -> None:
    """Read an answer that has no body."""
    del content


def read_text(content: bytes) -> str:
    """Read an answer that is text."""
    return content.decode()


class Pending(Generic[A]):
    """The answer to a request that was accepted as a job.

    Args:
        sender: Sender of the client.
        job: Job as it was accepted.
        call: The request, which knows how to read its answer.
    """

    def __init__(self, sender: Sender, job: Job, call: Call[A]) -> None:
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

    def __init__(self, sender: AsyncSender, job: Job, call: Call[A]) -> None:
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


def create_call(
    where: str,
    read: Callable[[bytes], A],
    body: Body | RobotArchive,
    key: str | None = None,
    deadline: float | None = None,
) -> Call[A]:
    """The request that makes something new, which is sent again only where it has a key.

    Args:
        where: Path of the list that it joins.
        read: Reads the answer's body.
        body: What is made.
        key: Key for the header Idempotency-Key.
        deadline: How long the service may take [s]; its default if None.
    """
    return Call("POST", where, read, body, key=key, deadline=deadline, repeatable=False)


def replace_call(where: str, read: Callable[[bytes], A], body: Body) -> Call[A]:
    """The request that stores a document at a path, which names it in place of its own name."""
    document = body.model_copy(update={"name": None})
    document.model_fields_set.discard("name")
    return Call("PUT", where, read, document)


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


def wait_until_ended(sender: Sender, job: str, timeout: float | None) -> Job:
    """Look at a job until it has ended.

    Raises:
        TransportTimeout: It has not in time.
    """
    pause, end = _FIRST_PAUSE, _end(timeout)
    while not (status := sender.send(job_call(job))).done:
        time.sleep(_next_pause(job, pause, end))
        pause = min(pause * _PAUSE_GROWTH, _MAX_PAUSE)
    return status


async def ended_async(sender: AsyncSender, job: str, timeout: float | None) -> Job:
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
