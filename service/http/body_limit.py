"""Bodies of requests: their size, the time in which they arrive, and where they wait for it.

A body is taken in whole before anything else is done with its request. A large one is written to a
file meanwhile, so that clients that send slowly take up no memory.
"""

import asyncio
import tempfile
import time

from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.http.errors import HttpProblemError
from service.http.fields import field
from service.http.job_context import JOB_CONTEXT

#: Key in the scope of a request with the instant at which it began to arrive, on the clock of
#: `time.monotonic` [s].
ARRIVAL = "armwright.arrival"
#: Key in the scope of a request with its whole body, where that came at once, behind the function
#: that it is received by: a request within the request, such as a replay, has another one.
BODY = "armwright.body"
#: Bodies up to this wait in memory, larger ones in a file [byte].
_IN_MEMORY = 256 * 1024
#: Nothing more of the body is read, so the connection can't be used again.
_CLOSE = {"Connection": "close"}


class BodyLimit:
    """Middleware that refuses bodies that are too large or that take too long.

    Args:
        app: The application behind it.
        max_size: Largest body [byte], with a Content-Length or without.
        silence: Longest silence within a body [s].
        deadline: Longest time in which a body arrives [s].
    """

    def __init__(self, app: ASGIApp, max_size: int, silence: float, deadline: float) -> None:
        self._app = app
        self._max_size = max_size
        self._silence = silence
        self._deadline = deadline

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on once its body is there.

        Raises:
            HttpProblemError: PAYLOAD_TOO_LARGE, REQUEST_TIMEOUT, INVALID_REQUEST.
            ClientDisconnect: The client left before.
        """
        if scope["type"] != "http" or JOB_CONTEXT in scope:
            await self._app(scope, receive, send)
            return
        has_arrived = (
            ARRIVAL in scope
        )  # whole, and waited for its turn: there is nothing to wait for
        arrival = scope.setdefault(ARRIVAL, time.monotonic())
        self._check_head(scope)
        message = await receive() if has_arrived else await self._in_time(receive, arrival)
        content, is_whole = _part(message)
        if is_whole:
            self._check_size(len(content))
        else:
            content = await self._stored(content, receive, arrival)
        unread = [content]

        async def receive_stored() -> Message:
            if unread:
                return {"type": "http.request", "body": unread.pop(), "more_body": False}
            return await receive()  # what remains to come is the disconnection, whenever that is

        if is_whole:
            scope[BODY] = receive_stored, content
        await self._app(scope, receive_stored, send)

    def _check_head(self, scope: Scope) -> None:
        announced = field(scope, b"content-length") or ""
        if announced and field(scope, b"transfer-encoding") is not None:
            # Which of the two counts is where proxies and servers differ (RFC 9112, 6.3).
            raise HttpProblemError(
                "INVALID_REQUEST",
                "the request has both Content-Length and Transfer-Encoding",
                _CLOSE,
                stage="request",
                status=400,
            )
        if announced.isdigit() and (
            len(announced) > len(str(self._max_size)) or int(announced) > self._max_size
        ):
            raise self._too_large()

    async def _stored(self, first: bytes, receive: Receive, arrival: float) -> bytes:
        """A body that comes in parts, which wait in a file if they are large."""
        with tempfile.SpooledTemporaryFile(_IN_MEMORY) as stored:
            part, size, is_whole = first, 0, False
            while True:
                size += len(part)
                self._check_size(size)
                stored.write(part)
                if is_whole:
                    break
                part, is_whole = _part(await self._in_time(receive, arrival))
            stored.seek(0)
            return stored.read()

    def _check_size(self, size: int) -> None:
        if size > self._max_size:
            raise self._too_large()

    async def _in_time(self, receive: Receive, arrival: float) -> Message:
        left = arrival + self._deadline - time.monotonic()
        try:
            # Not wait_for: until Python 3.12 it may swallow a cancellation.
            async with asyncio.timeout(max(min(self._silence, left), 0.0)):
                return await receive()
        except TimeoutError:
            late = f"the body did not arrive within {self._deadline:g} s"
            silent = f"nothing of the body arrived for {self._silence:g} s"
            raise HttpProblemError(
                "REQUEST_TIMEOUT",
                silent if self._silence < left else late,
                _CLOSE,
                stage="request",
            ) from None

    def _too_large(self) -> HttpProblemError:
        return HttpProblemError(
            "PAYLOAD_TOO_LARGE",
            f"the body is larger than {self._max_size} bytes",
            _CLOSE,
            stage="request",
            hint="Split the request, or raise ARMWRIGHT_MAX_BODY_SIZE where the service is run.",
            max_body_size=self._max_size,
        )


def _part(message: Message) -> tuple[bytes, bool]:
    """The part of a body that a message brings, and whether it is the last one.

    Raises:
        ClientDisconnect: It says that the client left.
    """
    if message["type"] == "http.disconnect":
        raise ClientDisconnect
    return message.get("body", b""), not message.get("more_body", False)
