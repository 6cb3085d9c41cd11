"""Connections of uvicorn with limits: how many there are, and how long and large a head may be.

A head that never ends, or connections without requests, hold memory and descriptors before any
layer of the application is asked.
"""

import asyncio
import resource
import sys
from collections.abc import Callable
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from service.http.errors import PROBLEM_MEDIA_TYPE, headers_of, problem_content, status_of
from service.http.layer.middleware import SECURITY_HEADERS
from service.validation import ProblemError

#: Descriptors that are left for the storage, the workers and files.
_RESERVED_DESCRIPTORS = 128
#: Longest head, trailer or extension of a chunk, beyond the read in which it begins [byte].
_HEAD_BYTES = 64 * 1024


@dataclass(frozen=True, slots=True)
class ConnectionLimits:
    """Limits of connections.

    Args:
        count: Connections that may be open at the same time.
        head_timeout: Time in which the head of a request must arrive [s].
    """

    count: int
    head_timeout: float


def possible_connections(wanted: int) -> int:
    """The connections that the system's limit of descriptors allows, at most `wanted`.

    The limit is raised as far as the system allows it.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and soft < hard:
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
        soft = hard
    return max(1, min(wanted, soft - _RESERVED_DESCRIPTORS))


def connection_class(limits: ConnectionLimits) -> Callable[..., "Connection"]:
    """The function that makes a protocol for each connection, as uvicorn calls it."""

    def make(**arguments: Any) -> Connection:
        return Connection(limits, **arguments)

    return make


class Connection(HttpToolsProtocol):
    """A connection of a client, refused in problem documents.

    Args:
        limits: Limits of connections.
        arguments: Arguments of uvicorn.
    """

    def __init__(self, limits: ConnectionLimits, **arguments: Any) -> None:
        super().__init__(**arguments)
        self._limits = limits
        self._is_in_head = True
        self._is_upgraded = False
        self._unparsed = 0
        self._head_timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for a request, or refuse the connection where there are too many."""
        super().connection_made(transport)
        if len(self.connections) <= self._limits.count:
            self._start_timer()
            return
        problem = ProblemError(
            "OVERLOADED",
            "too many connections are open",
            stage="connection",
            hint="Ask again after the time in Retry-After.",
            status=503,
            retry_after=1,
        )
        self._refuse(problem)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._stop_timer()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Parse what arrived; a head that has begun must end in time."""
        if self.transport.is_closing():
            return
        self._unparsed += len(data)
        super().data_received(data)
        if self._is_upgraded:
            return
        if self._unparsed > _HEAD_BYTES:
            self.send_400_response(f"the head is longer than {_HEAD_BYTES} bytes")
        elif self._is_in_head and (self.cycle is None or self.cycle.response_complete):
            self._start_timer()

    def handle_websocket_upgrade(self) -> None:
        """Leave the connection to a WebSocket: no head comes on it any more."""
        self._is_upgraded = True
        self._stop_timer()
        super().handle_websocket_upgrade()

    def on_header(self, name: bytes, value: bytes) -> None:
        """Take a header; trailers are dropped, as they must not pass for headers."""
        if self._is_in_head:
            super().on_header(name, value.rstrip(b" \t"))

    def on_headers_complete(self) -> None:
        """Have a request answered whose head has arrived.

        Raises:
            ValueError: Its target is no path, which the scope of the request does not tell.
        """
        self._is_in_head, self._unparsed = False, 0
        self._stop_timer()
        if not self.url.startswith(b"/"):
            raise ValueError("the target of the request must begin with /")
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """Take a part of a body."""
        self._unparsed = 0
        super().on_body(body)

    def on_message_complete(self) -> None:
        """End a request."""
        self._is_in_head, self._unparsed = True, 0
        super().on_message_complete()

    def send_400_response(self, msg: str) -> None:
        """Refuse what is no HTTP."""
        fault = sys.exc_info()[1]  # that of the parser, which uvicorn does not pass on
        problem = ProblemError(
            "INVALID_REQUEST",
            msg if fault is None else str(fault.__context__ or fault),
            stage="connection",
            hint="The request must follow HTTP/1.1 (RFC 9112).",
            status=400,
        )
        self._refuse(problem)

    def _start_timer(self) -> None:
        if self._head_timer is None and not self.transport.is_closing():
            self._head_timer = self.loop.call_later(self._limits.head_timeout, self._head_is_late)

    def _stop_timer(self) -> None:
        if self._head_timer is not None:
            self._head_timer.cancel()
            self._head_timer = None

    def _head_is_late(self) -> None:
        seconds = self._limits.head_timeout
        problem = ProblemError(
            "REQUEST_TIMEOUT",
            f"the head of a request did not arrive within {seconds:g} s",
            stage="connection",
        )
        self._refuse(problem)

    def _refuse(self, problem: ProblemError) -> None:
        """Answer a problem in place of a request that never came, and close."""
        self._stop_timer()
        if self.transport.is_closing():
            return
        content, status = problem_content(problem, ""), status_of(problem)
        headers = (
            SECURITY_HEADERS
            | headers_of(problem)
            | {
                "Content-Type": PROBLEM_MEDIA_TYPE,
                "Content-Length": str(len(content)),
                "Connection": "close",
            }
        )
        lines = [f"HTTP/1.1 {status} {HTTPStatus(status).phrase}"]
        lines += [f"{name}: {value}" for name, value in headers.items()]
        cycle = self.cycle
        if cycle is None or cycle.response_complete or not cycle.response_started:
            self.transport.write("\r\n".join([*lines, "", ""]).encode() + content)
        self.transport.close()
