"""Hosts and origins: requests in the name of a foreign host, and changes by foreign pages.

A page of a foreign site may have its own name resolve to this machine and then ask the service as
if it were that site (DNS rebinding). The header Host tells: it holds the foreign name. It may also
send a form here, which browsers do without asking first (multipart, plain text). The headers Origin
and Sec-Fetch-Site tell, which no page can change; programs that are no browsers send neither.
"""

import ipaddress
import re

from starlette.types import ASGIApp, Receive, Scope, Send

from service.http.errors import HttpProblemError
from service.http.fields import field
from service.http.job_context import JOB_CONTEXT

#: Allows every name, or every origin.
ANY_HOST = "*"
#: Methods that change nothing.
_READING = frozenset({"GET", "HEAD", "OPTIONS"})
_HOST = re.compile(r"(?P<name>\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._\-]+)(:[0-9]{1,5})?")


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
        origins: Whose pages may ask, "*" for all.
    """
    if ANY_HOST in origins or origin in origins or site == "same-origin":
        return False
    if origin is None:
        return site == "cross-site"
    # A proxy with TLS in front changes the scheme, and not the name.
    return origin not in (f"http://{host}", f"https://{host}")


class HostCheck:
    """Middleware that refuses requests for foreign hosts, and changes by foreign pages.

    Args:
        app: The application behind it.
        names: As `allowed_host` has them.
        origins: Whose pages may change things, "*" for all.
    """

    def __init__(self, app: ASGIApp, names: frozenset[str], origins: tuple[str, ...] = ()) -> None:
        self._app = app
        self._names = names
        self._origins = origins
        self._allowed = ""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on.

        Raises:
            HttpProblemError: HOST_NOT_ALLOWED, FORBIDDEN.
        """
        if scope["type"] == "http" and JOB_CONTEXT not in scope:
            host = field(scope, b"host")
            # HTTP/1.1 without the header is refused by the parser; older requests come from probes.
            if host is not None and host != self._allowed:
                self._check(host)
            if scope["method"] not in _READING:
                origin, site = field(scope, b"origin"), field(scope, b"sec-fetch-site")
                if is_foreign(origin, site, host, self._origins):
                    raise _foreign(origin or "another site")
        await self._app(scope, receive, send)

    def _check(self, host: str) -> None:
        if not allowed_host(host, self._names):
            raise HttpProblemError(
                "HOST_NOT_ALLOWED",
                f"this service does not answer for the host {host[:100]!r}",
                {"Connection": "close"},
                stage="request",
                hint="List the name in ARMWRIGHT_ALLOWED_HOSTS where the service is run.",
            )
        self._allowed = host  # most requests come in the same name


def _foreign(origin: str) -> HttpProblemError:
    return HttpProblemError(
        "FORBIDDEN",
        f"a page of {origin[:100]!r} may not change anything here",
        {"Connection": "close"},
        stage="request",
        hint="List its origin in ARMWRIGHT_CORS_ORIGINS where the service is run.",
    )
