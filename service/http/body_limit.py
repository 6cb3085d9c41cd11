"""Limits of request bodies: their size, and the time in which they arrive."""

import asyncio

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.http.errors import HttpProblemError

#: Nothing more of the body is read, so the connection can't be used again.
_CLOSE = {"Connection": "close"}


class BodyLimit:
    """Middleware that refuses bodies that are too large or that stop arriving.

    Args:
        app: The application behind it.
        max_size: Largest body [byte], with a Content-Length or without.
        timeout: Longest silence within a body [s].
    """

    def __init__(self, app: ASGIApp, max_size: int, timeout: float) -> None:
        self._app = app
        self._max_size = max_size
        self._timeout = timeout

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        announced = Headers(scope=scope).get("content-length", "")
        too_large = announced.isdigit() and (
            len(announced) > len(str(self._max_size)) or int(announced) > self._max_size
        )
        size, complete = 0, False

        async def receive_limited() -> Message:
            nonlocal size, complete
            if complete:  # what remains to come is the disconnection, whenever that is
                return await receive()
            if too_large:
                raise self._too_large()
            message = await self._in_time(receive)
            size += len(message.get("body", b""))
            complete = not message.get("more_body", False)
            if size > self._max_size:
                raise self._too_large()
            return message

        await self._app(scope, receive_limited, send)

    async def _in_time(self, receive: Receive) -> Message:
        try:
            # Not wait_for: until Python 3.12 it may swallow a cancellation.
            async with asyncio.timeout(self._timeout):
                return await receive()
        except TimeoutError:
            raise HttpProblemError(
                "REQUEST_TIMEOUT",
                f"nothing of the body arrived for {self._timeout:g} s",
                stage="request",
                headers=_CLOSE,
            ) from None

    def _too_large(self) -> HttpProblemError:
        return HttpProblemError(
            "PAYLOAD_TOO_LARGE",
            f"the body is larger than {self._max_size} bytes",
            stage="request",
            hint="Split the request, or raise ARMWRIGHT_MAX_BODY_SIZE where the service is run.",
            headers=_CLOSE,
            max_body_size=self._max_size,
        )
