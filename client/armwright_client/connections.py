"""Connections of the synchronous client, by the standard library: a quarter of httpx's time.

Responses are read by llhttp where that is installed. Errors are those of httpx, so that both
clients tell the same.
"""

import http.client
import select
import time
import weakref
from collections import deque
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, overload
from urllib.request import getproxies

import httpx

from armwright_client.request_head import RequestHeads

try:
    from armwright_client.llhttp import ParsedResponse
except ImportError:  # httptools is not installed
    _Response: Any = http.client.HTTPResponse
else:
    _Response = ParsedResponse

#: Connections that are kept open, at most: one for each thread that asks at the same time.
_KEPT = 20
#: Time after which kept connections are not used again [s]: servers close them after five.
_IDLE = 4.0
#: Heads and bodies up to this together are sent at once [byte]: copying them costs less than that.
_JOINED_BYTES = 64 * 1024
#: Errors of httpx for those of a connection that is open, the first that fits.
_ERRORS: tuple[tuple[type[Exception], type[httpx.RequestError]], ...] = (
    (http.client.HTTPException, httpx.RemoteProtocolError),
    (TimeoutError, httpx.ReadTimeout),
    (OSError, httpx.NetworkError),
)
_BROKEN = tuple(of for of, _ in _ERRORS)


class Headers(Protocol):
    """Headers of a response, whose names are looked up in either case."""

    @overload
    def get(self, name: str, /) -> str | None: ...
    @overload
    def get(self, name: str, default: str, /) -> str: ...
    def get(self, name: str, default: str | None = None, /) -> str | None:
        """The value of a header."""

    def items(self) -> Iterable[tuple[str, str]]:
        """All names and values."""


class Response(Protocol):
    """A response that was read to its end: of httpx, or `Received`."""

    @property
    def status_code(self) -> int:
        """The HTTP status."""

    @property
    def is_success(self) -> bool:
        """Whether the status is 2xx."""

    @property
    def headers(self) -> Headers:
        """Its headers."""

    @property
    def content(self) -> bytes:
        """Its body, unpacked."""

    @property
    def text(self) -> str:
        """Its body as text."""

    @property
    def reason_phrase(self) -> str:
        """The words of its status."""


@dataclass(frozen=True, slots=True)
class Received:
    """A response that was read: to make one of httpx takes longer than to read a plan.

    Args:
        status_code: The HTTP status.
        headers: Its headers.
        content: Its body, unpacked.
    """

    status_code: int
    headers: Headers
    content: bytes

    @property
    def is_success(self) -> bool:
        """Whether the status is 2xx."""
        return 200 <= self.status_code < 300

    @property
    def text(self) -> str:
        """The body as text, as httpx decodes it."""
        # The body was unpacked: httpx must not do it again.
        told = [field for field in self.headers.items() if field[0].lower() != "content-encoding"]
        return httpx.Response(self.status_code, headers=told, content=self.content).text

    @property
    def reason_phrase(self) -> str:
        """The words of the status."""
        return httpx.codes.get_reason_phrase(self.status_code)


class _Joined(http.client.HTTPConnection):
    """A connection that sends the head of a request together with a short body.

    Sent apart they cost two system calls and wake the service twice.
    """

    response_class = _Response
    _held: bytes | None = None

    def request(self, *args: Any, **options: Any) -> None:
        """Send a request."""
        self._held = b""
        try:
            super().request(*args, **options)
            held, self._held = self._held, None
            if held:
                super().send(held)
        finally:
            self._held = None

    def send(self, data: Any) -> None:
        """Send bytes, short ones together with the next ones of their request."""
        if self._held is None or not isinstance(data, bytes):
            super().send(data)
        elif len(self._held) + len(data) <= _JOINED_BYTES:
            self._held += data
        else:
            held, self._held = self._held, b""
            if held:
                super().send(held)
            super().send(data)


class _JoinedSecure(_Joined, http.client.HTTPSConnection):
    """A connection that does so and is encrypted."""


class _Idle(NamedTuple):
    """A connection that waits for the next request.

    Args:
        connection: It is open.
        since: When it was used last, by `time.monotonic` [s].
    """

    connection: http.client.HTTPConnection
    since: float


class Connections:
    """Connections to one service, which threads may share.

    Args:
        base_url: Of the service.
    """

    def __init__(self, base_url: str) -> None:
        self._url = httpx.URL(base_url)
        self._prefix = self._url.raw_path.decode("ascii").rstrip("/")
        self._context = httpx.create_ssl_context() if self._url.scheme == "https" else None
        default_port = http.client.HTTPS_PORT if self._context else http.client.HTTP_PORT
        self._heads = RequestHeads(self._url.host, self._url.port, default_port)
        self._idle: deque[_Idle] = deque()
        # Also where nobody closes them.
        weakref.finalize(self, _close_all, self._idle)

    def send(
        self,
        method: str,
        path: str,
        headers: Mapping[str, str],
        content: bytes | None,
        limits: httpx.Timeout,
    ) -> Received:
        """The response to a request, read to its end.

        Args:
            method: Of HTTP.
            path: Below the base URL.
            headers: Of the request.
            content: Its body, if it has one.
            limits: Longest waits for a connection and for the answer.

        Raises:
            RequestError: As httpx.
        """
        connection = self._idle_one() or self._open(limits.connect)
        try:
            with _AsHttpx():
                if connection.sock.gettimeout() != limits.read:  # to set it is a call of the system
                    connection.sock.settimeout(limits.read)
                exchange = _exchange if _Response is http.client.HTTPResponse else self._exchange
                response = exchange(connection, method, self._prefix + path, headers, content)
                body = response.read()
        except BaseException:
            connection.close()
            raise
        if not response.will_close:
            self._keep(connection)
        if response.headers.get("Content-Encoding", "identity") != "identity":
            told = list(response.headers.items())
            body = httpx.Response(response.status, headers=told, content=body).content
        return Received(response.status, response.headers, body)

    def _exchange(
        self,
        connection: http.client.HTTPConnection,
        method: str,
        target: str,
        headers: Mapping[str, str],
        content: bytes | None,
    ) -> Any:
        """The response to a request that is sent and read past the standard library."""
        data = self._heads.head(method, target, headers, content)
        with suppress(BrokenPipeError, ConnectionResetError):  # as `_exchange`
            if content and len(data) + len(content) > _JOINED_BYTES:
                connection.send(data)
                connection.send(content)
            else:
                connection.send(data + content if content else data)
        response = _Response(connection.sock, method=method)
        response.begin()
        if response.will_close:
            connection.close()
        return response

    def close(self) -> None:
        """Close all that are not in use."""
        _close_all(self._idle)

    def _idle_one(self) -> http.client.HTTPConnection | None:
        """The connection that was used last, if the service surely has it open still."""
        while self._idle:
            try:
                connection, since = self._idle.pop()
            except IndexError:
                # Another thread took it.
                return None
            if time.monotonic() - since <= _IDLE and not _has_ended(connection):
                return connection
            connection.close()
        return None

    def _keep(self, connection: http.client.HTTPConnection) -> None:
        self._idle.append(_Idle(connection, time.monotonic()))
        if len(self._idle) > _KEPT:
            self._idle.popleft().connection.close()

    def _open(self, longest: float | None) -> http.client.HTTPConnection:
        """A new connection; ``longest`` is the longest wait for it [s]."""
        host, port = self._url.host, self._url.port
        if self._context is None:
            connection: http.client.HTTPConnection = _Joined(host, port, timeout=longest)
        else:
            connection = _JoinedSecure(host, port, timeout=longest, context=self._context)
        try:
            connection.connect()
        except TimeoutError as error:
            raise httpx.ConnectTimeout(str(error)) from error
        except OSError as error:
            raise httpx.ConnectError(str(error)) from error
        return connection


def _exchange(
    connection: http.client.HTTPConnection,
    method: str,
    target: str,
    headers: Mapping[str, str],
    content: bytes | None,
) -> Any:
    """The response to a request, by the standard library."""
    # A service may refuse a long body, and close, before all of it was sent.
    with suppress(BrokenPipeError, ConnectionResetError):
        connection.request(method, target, content, headers)
    return connection.getresponse()


def direct(base_url: str, transport: httpx.BaseTransport | None) -> Connections | None:
    """Connections straight to a service; None where a transport or a proxy is in between."""
    return None if transport is not None or getproxies() else Connections(base_url)


def _close_all(idle: deque[_Idle]) -> None:
    while idle:
        idle.pop().connection.close()


def _has_ended(connection: http.client.HTTPConnection) -> bool:
    """Whether the service has closed a connection, or has sent what nobody asked for."""
    wait = select.poll()
    wait.register(connection.sock, select.POLLIN)
    return bool(wait.poll(0))


class _AsHttpx:
    """Context in which errors of a connection are raised again as httpx's."""

    __slots__ = ()

    def __enter__(self) -> None:
        """Begin."""

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        """End."""
        if isinstance(error, _BROKEN):
            raise next(to for of, to in _ERRORS if isinstance(error, of))(str(error)) from error
