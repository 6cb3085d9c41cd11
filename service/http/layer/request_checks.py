"""Checks of a request: the form of its head, its host, the page that sends it, and its body.

The parser (llhttp, as uvicorn uses it) refuses most of what is malformed. What it lets pass, and
has no single meaning (RFC 9112), is refused here: where servers and proxies differ, requests are
smuggled.

A page of a foreign site may have its own name resolve to this machine and then ask the service as
if it were that site (DNS rebinding). The header Host tells: it holds the foreign name. It may also
send a form here, which browsers do without asking first (multipart, plain text). The headers Origin
and Sec-Fetch-Site tell, which no page can change; programs that are no browsers send neither.

A body is taken in whole before anything else is done with its request. A large one is written to a
file meanwhile, so that clients that send slowly take up no memory.
"""

import asyncio
import ipaddress
import re
import tempfile
import time
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from starlette.requests import ClientDisconnect
from starlette.types import Message, Receive, Scope

from service.http.request_headers import FIELDS, values
from service.validation import ProblemError, request_problem

#: Key in the scope of a request with the instant at which it began to arrive, on the clock of
#: `time.monotonic` [s].
ARRIVAL = "armwright.arrival"
#: Bodies up to this wait in memory, larger ones in a file [byte].
_IN_MEMORY = 256 * 1024
#: Nothing more of the body is read, so the connection can't be used again.
_CLOSE = {"Connection": "close"}
_VERSIONS = ("1.0", "1.1")
#: Allows every name, or every origin.
ANY_HOST = "*"
#: Methods that change nothing.
_READING = frozenset({"GET", "HEAD", "OPTIONS"})
_HOST = re.compile(r"(?P<name>\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._\-]+)(:[0-9]{1,5})?")


def _refused(code: str, detail: str, **more: Any) -> ProblemError:
    """A fault of a request that ends its connection."""
    return request_problem(code, detail, headers=_CLOSE, **more)


def check_head(scope: Scope) -> None:
    """Refuse a head that the parser lets pass and that has no single meaning.

    Args:
        scope: Scope of the request.

    Raises:
        ProblemError: INVALID_REQUEST: another version of HTTP, no header Host or several, a
            transfer encoding that is not served, or a body behind the offer of another protocol,
            which the parser leaves unread.
    """
    version, hosts, has_body, upgrades = scope["http_version"], 0, False, False
    if version not in _VERSIONS:
        raise _malformed(f"HTTP/{version} is not served")
    for name, value in scope["headers"]:
        if name == b"host":
            hosts += 1
        elif name == b"transfer-encoding":
            has_body = True
            if value.lower() != b"chunked":
                raise _malformed("of transfer encodings only chunked is served")
        elif name == b"content-length":
            has_body = has_body or value.strip(b"0") != b""
        elif name == b"upgrade":
            upgrades = True
    if hosts > 1 or (hosts == 0 and version != "1.0"):
        raise _malformed("the request must have one header Host")
    if has_body and upgrades and offers_upgrade(scope):
        raise _malformed("a request that offers another protocol can't have a body")


def offers_upgrade(scope: Scope) -> bool:
    """Whether a request offers to go on in another protocol, of which none is served."""
    if not values(scope, b"upgrade"):
        return False
    return any("upgrade" in value.lower() for value in values(scope, b"connection"))


def _malformed(detail: str) -> ProblemError:
    return _refused(
        "INVALID_REQUEST",
        detail,
        hint="The request must follow HTTP/1.1 (RFC 9112).",
        status=400,
    )


@lru_cache(256)
def allowed_host(header: str, names: frozenset[str]) -> bool:
    """Whether a request with this header Host may be answered.

    Addresses and names without a dot are always: nobody can register them, so nobody can have
    them resolve to this machine. Of other names those on the list are.

    Args:
        header: The value of the header, perhaps with a port.
        names: Further names that are allowed, in lower case; one that begins with a dot stands for
            all names below it.
    """
    match = _HOST.fullmatch(header)
    if match is None:
        return False
    name = match["name"].lower().rstrip(".")
    if ANY_HOST in names or name in names or "." not in name.strip("[]").replace(":", ""):
        return True
    if any(name.endswith(parent) for parent in names if parent.startswith(".")):
        return True
    return _is_address(name.strip("[]"))


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def is_foreign(
    origin: str | None, site: str | None, host: str | None, origins: tuple[str, ...]
) -> bool:
    """Whether a request comes from a page that is neither of this service nor one of a list.

    Args:
        origin: The header Origin; None where there is none.
        site: The header Sec-Fetch-Site; None where there is none.
        host: The header Host.
        origins: Origins whose pages may ask, "*" for all.
    """
    if ANY_HOST in origins or origin in origins or site == "same-origin":
        return False
    if origin is None:
        return site == "cross-site"
    # A proxy with TLS in front changes the scheme, and not the name.
    return origin not in (f"http://{host}", f"https://{host}")


def check_host(scope: Scope, names: frozenset[str], origins: tuple[str, ...]) -> None:
    """Refuse requests for foreign hosts, and changes by foreign pages.

    Args:
        scope: Scope of the request, with its `FIELDS`.
        names: Names as `allowed_host` has them.
        origins: Origins whose pages may change things, "*" for all.

    Raises:
        ProblemError: HOST_NOT_ALLOWED, FORBIDDEN.
    """
    fields = scope[FIELDS]
    host = fields.get("host")
    # HTTP/1.1 without the header is refused by `check_head`; older requests come from probes.
    if host is not None and not allowed_host(host, names):
        raise _refused(
            "HOST_NOT_ALLOWED",
            f"this service does not answer for the host {host[:100]!r}",
            hint="List the name in ARMWRIGHT_ALLOWED_HOSTS where the service is run.",
        )
    if scope["method"] in _READING:
        return
    origin, site = fields.get("origin"), fields.get("sec-fetch-site")
    if is_foreign(origin, site, host, origins):
        raise _refused(
            "FORBIDDEN",
            f"a page of {(origin or 'another site')[:100]!r} may not change anything here",
            hint="List its origin in ARMWRIGHT_CORS_ORIGINS where the service is run.",
        )


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
        scope: Scope of the request, with its `FIELDS` and the instant `ARRIVAL`.
        receive: Channel of the request.
        limits: Limits of the body.

    Raises:
        ProblemError: PAYLOAD_TOO_LARGE, REQUEST_TIMEOUT.
        ClientDisconnect: The client left before.
    """
    announced = scope[FIELDS].get("content-length", "")
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
        raise _refused(
            "REQUEST_TIMEOUT",
            silent if limits.silence < left else late,
        ) from None


def _check_size(size: int, limits: BodyLimits) -> None:
    if size > limits.max_size:
        raise _too_large(limits)


def _too_large(limits: BodyLimits) -> ProblemError:
    return _refused(
        "PAYLOAD_TOO_LARGE",
        f"the body is larger than {limits.max_size} bytes",
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
