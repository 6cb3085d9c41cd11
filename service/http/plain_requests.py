"""Plain requests: all layers around the application in one step, for those that they let pass.

Each layer costs a coroutine, a function to send by and a look at the headers: together more than
the way from a request to its worker. Of most requests they want little: an id, a line in the log, a
place in the metrics, and the same headers in each answer.
"""

import asyncio
import time
from typing import Protocol

from fastapi import FastAPI, Request, Response
from starlette.types import Message, Receive, Scope, Send

from service import logs
from service.access.authentication import Authenticator
from service.http.body_limit import BODY
from service.http.compression import Compression, add_vary
from service.http.direct_routes import RouteTable, answer_directly
from service.http.handlers import response_to
from service.http.host_check import allowed_host
from service.http.json_answer import JsonAnswer
from service.http.json_route import JsonRoute
from service.http.metrics import Metrics
from service.http.request_log import add_id, log_request
from service.http.security_headers import SECURITY_HEADERS, add_security_headers
from service.settings import Settings

#: Headers that no layer looks at, but at the host: those that every client sends.
_PLAIN = frozenset(
    {
        b"host", b"accept", b"accept-encoding", b"user-agent", b"content-type", b"content-length",
        b"connection",
    }
)  # fmt: skip
_JSON = b"application/json"
#: Names of hosts that are remembered as allowed.
_HOSTS = 64
_VARY = b"vary: Accept-Encoding\r\n"
#: The head of an answer of JSON behind its first lines: its length, perhaps `_VARY`, its id.
_HEAD = (
    b"content-length: %d\r\ncontent-type: application/json\r\n%b"
    + b"".join(f"{n.lower()}: {v}\r\n".encode() for n, v in SECURITY_HEADERS.items())
    + b"x-request-id: %b\r\n\r\n"
)


class Writer(Protocol):
    """Whoever can write an answer whole."""

    def write_answer(self, head: bytes, content: bytes) -> bool:
        """Write an answer of status 200, unless something is in the way.

        Args:
            head: Its fields, with the line that ends them.
            content: Its body.

        Returns:
            Whether that was done.
        """


class PlainRequests:
    """Answers plain requests as all layers around the application together would.

    A request is plain if it has arrived whole, with a body of JSON for a route that takes nothing
    else, and no header but those that every client sends; and if it is known that the service needs
    no keys. All others take the way through the layers.

    Args:
        application: Whose routes they are.
        settings: Limits and hosts.
        metrics: What counts the requests.
        minimum_size: Of answers that are compressed for others [byte].
    """

    def __init__(
        self, application: FastAPI, settings: Settings, metrics: Metrics, minimum_size: int
    ) -> None:
        self._application = application
        self._routes = RouteTable(application)
        self._settings = settings
        self._metrics = metrics
        self._minimum_size = minimum_size
        self._excluded = Compression(application).exclude_content_types
        self._hosts: set[bytes] = set()

    def route(self, scope: Scope) -> JsonRoute | None:
        """The route of a request that has arrived whole, if it is plain; None for all others."""
        route = self._routes.find(scope)
        if route is None or route.handle_plain is None:
            return None
        authenticator: Authenticator = self._application.state.authenticator
        if not authenticator.is_open:
            return None
        kind, length, host = b"", b"", b""
        for name, value in scope["headers"]:
            if name not in _PLAIN:
                return None
            if name == b"content-type":
                kind = value
            elif name == b"content-length":
                length = value
            elif name == b"host":
                host = value
            elif name == b"accept-encoding" and b"gzip" in value:
                return None
        fits = length.isdigit() and 0 < int(length) <= self._settings.max_body_size
        return route if fits and kind == _JSON and self._is_allowed(host) else None

    def _is_allowed(self, host: bytes) -> bool:
        if host in self._hosts:
            return True
        if not allowed_host(host.decode("latin-1"), self._settings.host_names):
            return False
        if len(self._hosts) >= _HOSTS:
            self._hosts.clear()
        self._hosts.add(host)
        return True

    async def answer(
        self,
        route: JsonRoute,
        content: bytes,
        writer: Writer,
        scope: Scope,
        receive: Receive,
        send: Send,
    ) -> None:
        """Answer a plain request.

        Args:
            route: As `route` gives it.
            content: The body.
            writer: Writes answers of the usual kind.
            scope: Of the request.
            receive: Of the request.
            send: Sends all other answers.
        """
        identity = logs.new_request_id(None)
        token = logs.request_id.set(identity)
        status, began = 500, time.perf_counter()
        scope["app"] = self._application
        scope[BODY] = receive, content

        async def send_with_headers(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                add_vary(message, self._minimum_size, self._excluded)
                add_security_headers(message)
                add_id(message, identity)
            await send(message)

        try:
            response = await _response(route, Request(scope, receive))
            if type(response) is JsonAnswer and self._is_written(response, identity, writer):
                status = 200
            elif response is not None:
                await response(scope, receive, send_with_headers)
        finally:
            seconds = time.perf_counter() - began
            self._metrics.count_request(route.path, scope["method"], status, seconds)
            log_request(scope, status, seconds)
            logs.request_id.reset(token)

    def _is_written(self, response: JsonAnswer, identity: str, writer: Writer) -> bool:
        """Write an answer at once, as it would be sent; False if it has to be sent."""
        content = bytes(response.body)
        varies = len(content) >= self._minimum_size
        head = _HEAD % (len(content), _VARY if varies else b"", identity.encode("latin-1"))
        return writer.write_answer(head, content)


async def _response(route: JsonRoute, request: Request) -> Response | None:
    try:
        return await answer_directly(route, request, is_plain=True)
    except (Exception, asyncio.CancelledError) as error:  # noqa: BLE001  (raised again or told)
        return response_to(error, request.scope, started=False)
