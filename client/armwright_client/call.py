"""Requests as values, and the methods that are made of them.

A method is written once, as a function from its arguments to a `Call`. `Endpoint` makes of it a
method that answers where the client is synchronous, and one to be awaited where it is not.
"""

from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, lru_cache, wraps
from inspect import Signature, signature
from types import MethodType
from typing import (
    TYPE_CHECKING,
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

from armwright_client.job import JobEvent
from armwright_client.robots.robot import RobotArchive
from armwright_wire.base import Body
from armwright_wire.errors import InvalidArgument

if TYPE_CHECKING:
    from armwright_client.pending import AsyncPending, Pending

P = ParamSpec("P")
A = TypeVar("A")

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
        body: To be sent, a request as JSON.
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


class Endpoint(Generic[P, A]):
    """Method of a client, made of a function that gives a `Call`.

    Raises:
        InvalidArgument: When the method is called with arguments that are refused.
    """

    def __init__(self, build: Callable[Concatenate[Any, P], Call[A]]) -> None:
        self._build = build
        self.__doc__ = build.__doc__

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


class JobEndpoint(Generic[P, A]):
    """Method whose request always becomes a job, made of a function that gives a `Call`."""

    def __init__(self, build: Callable[Concatenate[Any, P], Call[A]]) -> None:
        self._build = build
        self.__doc__ = build.__doc__

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


class EventEndpoint(Generic[P]):
    """Method that iterates over events, made of a function that gives an `EventCall`."""

    def __init__(self, build: Callable[Concatenate[Any, P], EventCall]) -> None:
        self._build = build
        self.__doc__ = build.__doc__

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
            raise InvalidArgument(_refusal(error)) from error
        return getattr(group._sender, action)(call)

    method.__signature__ = _signature(build, awaited, action)  # type: ignore[attr-defined]
    return method


def _signature(build: Callable[..., Any], awaited: bool, action: str) -> Signature:
    """The signature that users see: what comes back, not the call that is sent."""
    from armwright_client.pending import AsyncPending, Pending  # noqa: PLC0415  (imports this)

    shown = signature(build)
    answer = next(iter(get_args(shown.return_annotation)), None)
    if action == "stream":
        answer = AsyncIterator[JobEvent] if awaited else Iterator[JobEvent]
    elif action == "postpone":
        answer = Awaitable[AsyncPending[answer]] if awaited else Pending[answer]  # type: ignore[valid-type]
    elif awaited:
        answer = Awaitable[answer]  # type: ignore[valid-type]
    return shown.replace(return_annotation=answer)


def _refusal(error: ValidationError) -> str:
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
