"""Bodies of requests: their size, the time in which they arrive, and where they wait for it.

A body is taken in whole before anything else is done with its request. A large one is written to a
file meanwhile, so that clients that send slowly take up no memory.
"""

import asyncio
import tempfile
import time
from dataclasses import dataclass

from starlette.requests import ClientDisconnect
from starlette.types import Message, Receive, Scope

from service.http.errors import HttpProblemError
from service.http.fields import field

#: Key in the scope of a request with the instant at which it began to arrive, on the clock of
#: `time.monotonic` [s].
ARRIVAL = "armwright.arrival"
#: Bodies up to this wait in memory, larger ones in a file [byte].
_IN_MEMORY = 256 * 1024
#: Nothing more of the body is read, so the connection can't be used again.
_CLOSE = {"Connection": "close"}


@dataclass(frozen=True, slots=True)
class BodyLimits:
    """Limits of request bodies.

    Args:
        max_size: Largest body [byte], with a Content-Length or without.
        silence: Longest silence within a body [s].
        deadline: Longest time in which a body arrives [s].
    """

    max_size: int
    silence: float
    deadline: float


async def read_body(scope: Scope, receive: Receive, limits: BodyLimits) -> bytes:
    """The whole body of a request.

    Args:
        scope: Of the request, with the instant `ARRIVAL`.
        receive: Of the request.
        limits: Of the body.

    Raises:
        HttpProblemError: PAYLOAD_TOO_LARGE, REQUEST_TIMEOUT.
        ClientDisconnect: The client left before.
    """
    announced = field(scope, b"content-length") or ""
    if announced.isdecimal() and (
        len(announced) > len(str(limits.max_size)) or int(announced) > limits.max_size
    ):
        raise _too_large(limits)
    part, is_whole = _part(await _in_time(scope, receive, limits))
    if is_whole:
        _check_size(len(part), limits)
        return part
    with tempfile.SpooledTemporaryFile(_IN_MEMORY) as stored:
        size = 0
        while True:
            size += len(part)
            _check_size(size, limits)
            stored.write(part)
            if is_whole:
                break
            part, is_whole = _part(await _in_time(scope, receive, limits))
        stored.seek(0)
        return stored.read()


async def _in_time(scope: Scope, receive: Receive, limits: BodyLimits) -> Message:
    left = scope[ARRIVAL] + limits.deadline - time.monotonic()
    try:
        # Not wait_for: until Python 3.12 it may swallow a cancellation.
        async with asyncio.timeout(max(min(limits.silence, left), 0.0)):
            return await receive()
    except TimeoutError:
        late = f"the body did not arrive within {limits.deadline:g} s"
        silent = f"nothing of the body arrived for {limits.silence:g} s"
        raise HttpProblemError(
            "REQUEST_TIMEOUT",
            silent if limits.silence < left else late,
            _CLOSE,
            stage="request",
        ) from None


def _check_size(size: int, limits: BodyLimits) -> None:
    if size > limits.max_size:
        raise _too_large(limits)


def _too_large(limits: BodyLimits) -> HttpProblemError:
    return HttpProblemError(
        "PAYLOAD_TOO_LARGE",
        f"the body is larger than {limits.max_size} bytes",
        _CLOSE,
        stage="request",
        hint="Split the request, or raise ARMWRIGHT_MAX_BODY_SIZE where the service is run.",
        max_body_size=limits.max_size,
    )


def _part(message: Message) -> tuple[bytes, bool]:
    """The part of a body that a message brings, and whether it is the last one.

    Raises:
        ClientDisconnect: It says that the client left.
    """
    if message["type"] == "http.disconnect":
        raise ClientDisconnect
    return message.get("body", b""), not message.get("more_body", False)
