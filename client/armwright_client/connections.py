"""Connections of the synchronous client: urllib3 takes a third less processor time than httpx.

Errors are those of httpx, so that both clients tell the same.
"""

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol
from urllib.request import getproxies

import httpx
import urllib3
import urllib3.connection
from urllib3 import exceptions
from urllib3.util import parse_url

#: Connections that are kept open, at most: one for each thread that asks at the same time.
_KEPT = 20
#: Time after which kept connections are not used again [s]: servers close them after five.
_IDLE = 4.0
#: Errors of httpx for those of urllib3, the first that fits.
_ERRORS: tuple[tuple[type[Exception], type[httpx.RequestError]], ...] = (
    (exceptions.ConnectTimeoutError, httpx.ConnectTimeout),
    (exceptions.ReadTimeoutError, httpx.ReadTimeout),
    (exceptions.TimeoutError, httpx.ReadTimeout),
    (exceptions.SSLError, httpx.ConnectError),
    (exceptions.DecodeError, httpx.DecodingError),
    (exceptions.ProtocolError, httpx.RemoteProtocolError),
    (exceptions.LocationValueError, httpx.UnsupportedProtocol),
    (exceptions.HTTPError, httpx.NetworkError),
)


#: Heads and bodies up to this together are sent at once [byte]: copying them costs less than that.
_JOINED_BYTES = 64 * 1024
#: Nothing is sent again by the library: `armwright_client.retry` says when it is.
_NO_RETRY = urllib3.Retry(False, redirect=False)


class Response(Protocol):
    """A response that was read to its end: of httpx, or `Received`."""

    @property
    def status_code(self) -> int:
        """The HTTP status."""

    @property
    def is_success(self) -> bool:
        """Whether the status is 2xx."""

    @property
    def headers(self) -> Mapping[str, str]:
        """Its headers, whose names are looked up in either case."""

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
    """A response as urllib3 has read it: to make one of httpx takes longer than to read a plan.

    Args:
        status_code: The HTTP status.
        headers: Its headers.
        content: Its body, unpacked.
    """

    status_code: int
    headers: Mapping[str, str]
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


class _Connection(urllib3.connection.HTTPConnection):
    """A connection that sends the head of a request together with a short body.

    Sent apart they cost two system calls and wake the service twice.
    """

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


class Connections:
    """Connections to one service, which threads may share.

    Args:
        base_url: Of the service.
    """

    def __init__(self, base_url: str) -> None:
        self._url = parse_url(base_url)
        self._prefix = (self._url.path or "").rstrip("/")
        secure = self._url.scheme == "https"
        self._context = httpx.create_ssl_context() if secure else None
        self._pool = self._open()
        self._used = time.monotonic()

    def _open(self) -> urllib3.HTTPConnectionPool:
        host, port = self._url.host or "", self._url.port
        if self._context is None:
            pool = urllib3.HTTPConnectionPool(host, port, maxsize=_KEPT)
            pool.ConnectionCls = _Connection
            return pool
        return urllib3.HTTPSConnectionPool(host, port, maxsize=_KEPT, ssl_context=self._context)

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
        if time.monotonic() - self._used > _IDLE:
            self._pool, idle = self._open(), self._pool
            idle.close()
        with _as_httpx():
            response = self._pool.urlopen(
                method,
                self._prefix + path,
                headers=headers,
                body=content,
                timeout=urllib3.Timeout(connect=limits.connect, read=limits.read),
                retries=_NO_RETRY,
                redirect=False,
                assert_same_host=False,
            )
            body = response.data
        self._used = time.monotonic()
        return Received(response.status, response.headers, body)

    def close(self) -> None:
        """Close all that are not in use."""
        self._pool.close()


def direct(base_url: str, transport: httpx.BaseTransport | None) -> Connections | None:
    """Connections straight to a service; None where a transport or a proxy is in between."""
    return None if transport is not None or getproxies() else Connections(base_url)


@contextmanager
def _as_httpx() -> Iterator[None]:
    try:
        yield
    except exceptions.HTTPError as error:
        kind = next(theirs for ours, theirs in _ERRORS if isinstance(error, ours))
        if isinstance(error, exceptions.NewConnectionError):
            kind = httpx.ConnectError
        raise kind(str(error)) from error
