"""Sends calls over HTTP: headers, timeouts, retries, and errors as exceptions."""

import asyncio
import time
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from itertools import count
from typing import Any, TypedDict, TypeVar, Unpack

import httpx
from pydantic import ValidationError

from armwright_client.call import AsyncPending, Call, EventCall, Pending
from armwright_client.errors import TransportError, TransportTimeout, UnexpectedAnswer, from_problem
from armwright_client.job import EventReader, Job, JobEvent
from armwright_client.robots.robot import RobotArchive
from armwright_client.version import VERSION
from armwright_wire.base import Body
from armwright_wire.errors import ArmwrightError, InvalidArgument
from armwright_wire.plans.job import Problem

#: Statuses that say "not now" rather than "no".
_NOT_NOW = (429, 503)


@dataclass(frozen=True, slots=True)
class Retry:
    """Number of retries and the wait between them, where the service says when to ask again.

    Only answers 429 and 503 with a Retry-After header are asked for again, and only requests that
    do the same when they are done twice.

    Args:
        attempts: How often a request is sent at most; 1 never asks again.
        longest_wait: Longest single wait [s]; where the service asks for more, its refusal is
            raised at once.
    """

    attempts: int = 3
    longest_wait: float = 10.0

    def wait(self, attempt: int, response: httpx.Response) -> float | None:
        """Time to wait [s] after the given attempt, counted from 1; None to give up."""
        if response.status_code not in _NOT_NOW or attempt >= self.attempts:
            return None
        seconds = retry_after(response)
        return seconds if seconds is not None and seconds <= self.longest_wait else None


def retry_after(response: httpx.Response) -> float | None:
    """Seconds of the header Retry-After; None where it is missing or unreadable."""
    value = response.headers.get("retry-after", "").strip()
    if value.isascii() and value.isdigit():
        return float(value)
    try:
        moment = parsedate_to_datetime(value)
    except ValueError:
        return None
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=UTC)
    return max(0.0, (moment - datetime.now(UTC)).total_seconds())


A = TypeVar("A")

#: Read timeout [s]: six times the service's default deadline.
_TIMEOUT = 60.0
#: Longest wait for a connection [s]; a host that takes longer does not answer at all.
_CONNECT = 10.0
#: How much later than its deadline an answer may come [s]: the network both ways, and the end of a
#: worker that overran.
_GRACE = 10.0
#: Connections of a client: idle ones are closed before the service closes them, after 5 s.
_CONNECTIONS = httpx.Limits(max_connections=100, max_keepalive_connections=20, keepalive_expiry=4.0)
#: What may be wrong with a transport.
_TRANSPORT_ERRORS = (httpx.HTTPError, httpx.InvalidURL, httpx.StreamError)
#: Length of the excerpt of a foreign body [characters], enough to recognise it.
_EXCERPT = 200


class ClientOptions(TypedDict, total=False):
    """Options of a client beyond the URL.

    Args:
        token: Sent as ``Authorization: Bearer``.
        timeout: Longest wait for an answer [s], 60 if left out. A request with a `timeout` of its
            own is waited for as long as that allows, and some seconds more.
        retry: Rule of when to ask again.
        compress: Whether answers may come compressed: for slow networks.
    """

    token: str | None
    timeout: float
    retry: Retry
    compress: bool


class Wire:
    """State shared by synchronous and asynchronous sending.

    Args:
        base_url: Base url of the service.
        options: See `ClientOptions`.

    Raises:
        InvalidArgument: The URL or the token is malformed.
    """

    def __init__(self, base_url: str, **options: Unpack[ClientOptions]) -> None:
        self._base_url = _valid_url(base_url)
        self._headers = {
            "Accept": "application/json, application/problem+json",
            "Accept-Encoding": "gzip" if options.get("compress", False) else "identity",
            "User-Agent": f"armwright-client/{VERSION}",
        }
        token = options.get("token")
        if token is not None:
            self._headers["Authorization"] = f"Bearer {_valid_token(token)}"
        self._timeout = options.get("timeout", _TIMEOUT)
        self._usual_limits = self._limits(self._timeout)
        self._retry = options.get("retry", Retry())

    def settings(self) -> dict[str, Any]:
        """Arguments for httpx's clients."""
        return {"base_url": self._base_url, "headers": self._headers, "limits": _CONNECTIONS}

    def arguments(self, call: Call[Any]) -> dict[str, Any]:
        """Arguments for httpx's `request`."""
        headers = dict(call.headers)
        if call.key is not None:
            headers["Idempotency-Key"] = call.key
        arguments: dict[str, Any] = {
            "method": call.method,
            "url": call.path,
            "params": call.query or None,
            "headers": headers,
            "timeout": self._limits_of(call),
        }
        match call.body:
            case Body():
                headers["Content-Type"] = "application/json"
                arguments["content"] = call.body.to_json().encode("utf-8")
            case RobotArchive():
                file = (f"{call.body.name}.zip", call.body.content, "application/zip")
                arguments |= {"files": {"file": file}, "data": call.body.fields()}
        return arguments

    def _limits_of(self, call: Call[Any]) -> httpx.Timeout:
        if call.deadline is None or call.deadline + _GRACE <= self._timeout:
            return self._usual_limits
        return self._limits(call.deadline + _GRACE)

    def _limits(self, read_timeout: float) -> httpx.Timeout:
        # Waiting for one of the client's own connections is no fault of the service.
        return httpx.Timeout(read_timeout, connect=min(self._timeout, _CONNECT), pool=None)

    def wait(self, call: Call[Any], attempt: int, response: httpx.Response) -> float | None:
        """Time to wait before sending again [s], None where that makes no sense."""
        if not call.repeatable and call.key is None:
            return None
        return self._retry.wait(attempt, response)


class Session:
    """Sends calls and waits for their answers."""

    def __init__(self, wire: Wire, transport: httpx.BaseTransport | None) -> None:
        self._wire = wire
        self._http = httpx.Client(**self._wire.settings(), transport=transport)

    def send(self, call: Call[A]) -> A:
        """The answer to a call."""
        for attempt in count(1):
            with _Transport(call, self._http):
                response = self._http.request(**self._wire.arguments(call))
            seconds = self._wire.wait(call, attempt, response)
            if seconds is None:
                break
            time.sleep(seconds)
        return answer(call, response)

    def postpone(self, call: Call[A]) -> Pending[A]:
        """The handle of the job that will have the answer to a call."""
        return Pending(self, self.send(as_job(call)), call)

    def stream(self, call: EventCall) -> Iterator[JobEvent]:
        """The events that answer a call, as they come."""
        reader = EventReader()
        with (
            _Transport(call, self._http),
            self._http.stream(**self._wire.arguments(call)) as response,
        ):
            if not response.is_success:
                response.read()
                raise failure(call, response)
            for line in response.iter_lines():
                yield from reader.feed(line)

    def close(self) -> None:
        """Close all connections."""
        self._http.close()


class AsyncSession:
    """Sends calls and lets others run until their answers come."""

    def __init__(self, wire: Wire, transport: httpx.AsyncBaseTransport | None) -> None:
        self._wire = wire
        self._http = httpx.AsyncClient(**self._wire.settings(), transport=transport)

    async def send(self, call: Call[A]) -> A:
        """The answer to a call."""
        for attempt in count(1):
            with _Transport(call, self._http):
                response = await self._http.request(**self._wire.arguments(call))
            seconds = self._wire.wait(call, attempt, response)
            if seconds is None:
                break
            await asyncio.sleep(seconds)
        return answer(call, response)

    async def postpone(self, call: Call[A]) -> AsyncPending[A]:
        """The handle of the job that will have the answer to a call."""
        return AsyncPending(self, await self.send(as_job(call)), call)

    async def stream(self, call: EventCall) -> AsyncIterator[JobEvent]:
        """The events that answer a call, as they come."""
        reader = EventReader()
        with _Transport(call, self._http):
            async with self._http.stream(**self._wire.arguments(call)) as response:
                if not response.is_success:
                    await response.aread()
                    raise failure(call, response)
                async for line in response.aiter_lines():
                    for event in reader.feed(line):
                        yield event

    async def close(self) -> None:
        """Close all connections."""
        await self._http.aclose()


def as_job(call: Call[Any]) -> Call[Job]:
    """The call that has another one made a job of.

    Raises:
        InvalidArgument: The other one computes nothing.
    """
    if call.method not in ("POST", "PUT"):
        raise InvalidArgument(f"{call.method} {call.path} is answered at once, never later")
    headers = {**call.headers, "Prefer": "respond-async"}
    return replace(call, read=Job.read, headers=headers, deadline=None, repeatable=False)


def answer(call: Call[A], response: httpx.Response) -> A:
    """The answer in a response.

    Raises:
        ApiError: The service reports a problem.
        UnexpectedAnswer: The response is not the service's, or of another version.
    """
    if not response.is_success:
        raise failure(call, response)
    try:
        return call.read(response.content)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(step) for step in first["loc"]) or "the body"
        raise UnexpectedAnswer(
            f"{call.method} {call.path} was answered {response.status_code} with something else "
            f"than {error.title} ({where}: {first['msg']})",
            response.status_code,
            response.text[:_EXCERPT],
        ) from error


def failure(call: Call[Any], response: httpx.Response) -> ArmwrightError:
    """The error that a response reports; `UnexpectedAnswer` if it is not from the service."""
    problem = _problem(response)
    if problem is not None:
        return from_problem(problem, response.status_code, retry_after(response))
    outcome = (
        f"{call.method} {call.path} was answered {response.status_code} {response.reason_phrase}"
    )
    location = response.headers.get("location")
    if location is not None:
        outcome += f" to {location}"
    return UnexpectedAnswer(
        f"{outcome} by something that is not an Armwright service",
        response.status_code,
        response.text[:_EXCERPT],
    )


def _problem(response: httpx.Response) -> Problem | None:
    media_type = response.headers.get("content-type", "").split(";")[0].strip().lower()
    if media_type not in ("application/problem+json", "application/json"):
        return None
    try:
        problem = Problem.read(response.content)
    except ValidationError:
        return None
    return problem if problem.code or media_type == "application/problem+json" else None


class _Transport:
    """Context in which errors of httpx are raised again as those of the client.

    Args:
        call: Call that is sent.
        http: Client of httpx that sends it.

    Raises:
        TransportError: The client is closed, or something is wrong with the transport.
    """

    __slots__ = ("_call",)

    def __init__(self, call: Call[Any], http: httpx.Client | httpx.AsyncClient) -> None:
        if http.is_closed:
            raise TransportError("the client is closed")
        self._call = call

    def __enter__(self) -> None:
        """Begin."""

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        """End."""
        if not isinstance(error, _TRANSPORT_ERRORS):
            return
        late = isinstance(error, httpx.TimeoutException)
        text = f"{self._call.method} {self._call.path}: {_describe(error)}"
        raise (TransportTimeout if late else TransportError)(text) from error


def _describe(error: Exception) -> str:
    return f"{type(error).__name__} ({error})" if str(error) else type(error).__name__


def _valid_url(base_url: str) -> str:
    try:
        url = httpx.URL(base_url)
    except (httpx.InvalidURL, TypeError) as error:
        raise InvalidArgument(f"this is not a base URL: {error}") from None
    if url.scheme not in ("http", "https") or not url.host or url.query or url.fragment:
        raise InvalidArgument("the base URL must look like http://host:port or https://host/prefix")
    return base_url


def _valid_token(token: str) -> str:
    # The value stays out of the message: it is a secret.
    if not token or not token.isascii() or not token.isprintable() or " " in token:
        raise InvalidArgument("the token must be printable ASCII without spaces")
    return token
