"""Parsing of requests by httptools (llhttp), strict wherever servers and proxies differ."""

import asyncio
from collections.abc import Iterable
from functools import partial
from typing import Any, cast

import httptools
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol, RequestResponseCycle

from service.http.known_heads import KnownHead

#: Parsed at a time, so that requests sent without waiting for answers are few at once [byte].
_PART_BYTES = 8 * 1024
#: A head, a trailer or an extension of a chunk is refused beyond this [byte].
_HEAD_BYTES = 64 * 1024
_VERSIONS = ("1.0", "1.1")
_FRAMING = (b"content-length", b"transfer-encoding")


class MalformedRequestError(ValueError):
    """A request that is no HTTP/1.1, or whose end is ambiguous."""


def check_head(version: str, target: bytes, headers: Iterable[tuple[bytes, bytes]]) -> None:
    """Refuse a head that llhttp lets pass and that has no single meaning (RFC 9112).

    Args:
        version: Of HTTP, such as "1.1".
        target: What is asked for.
        headers: Names in lower case, and values.

    Raises:
        MalformedRequestError: Another version, a target that is no path, no header Host or several,
            or a transfer encoding that is not served.
    """
    if version not in _VERSIONS:
        raise MalformedRequestError(f"HTTP/{version} is not served")
    if not target.startswith(b"/"):
        raise MalformedRequestError("the target of the request must begin with /")
    hosts = 0
    for name, value in headers:
        if name == b"host":
            hosts += 1
        elif name == b"transfer-encoding" and value.lower() != b"chunked":
            raise MalformedRequestError("of transfer encodings only chunked is served")
    if hosts > 1 or (hosts == 0 and version != "1.0"):
        raise MalformedRequestError("the request must have one header Host")


class RequestParser(HttpToolsProtocol):
    """A connection whose requests llhttp parses.

    Args:
        arguments: Of uvicorn.
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__(**arguments)
        self._active: RequestResponseCycle | None = None
        self._has_begun = False
        self._is_in_body = False
        self._is_muted = False
        self._framing = b""
        self._unheard = 0

    @property
    def _is_unanswered(self) -> bool:
        """Whether a request that has arrived whole was not answered yet."""
        if self.pipeline:
            return True
        return not (self._is_in_body or self.cycle is None or self.cycle.response_complete)

    @property
    def _expects_head(self) -> bool:
        """Whether a head is the next thing to arrive."""
        return not self._is_in_body and (self.cycle is None or self.cycle.response_complete)

    def connection_lost(self, exc: Exception | None) -> None:
        """Tell the request that is answered now; uvicorn tells the last one that was parsed."""
        self.pipeline.clear()
        if (active := self._active) is not None and not active.response_complete:
            active.disconnected = True
            active.message_event.set()
        super().connection_lost(exc)

    def _parse(self, data: bytes) -> bytes:
        """Parse what arrived, up to requests that have to wait for an answer to another.

        Returns:
            What has to wait.

        Raises:
            MalformedRequestError: It is no HTTP.
        """
        place = 0
        while place < len(data) and not self._is_unanswered:
            part = data[place : place + _PART_BYTES]
            self._unheard += len(part)
            try:
                self.parser.feed_data(part)
                place += len(part)
            except httptools.HttpParserUpgrade as offer:
                place += offer.args[0]
                self._ignore_offer()
            except httptools.HttpParserError as error:
                raise MalformedRequestError(_reason(error)) from error
            if self._unheard > _HEAD_BYTES:
                raise MalformedRequestError(f"the head is longer than {_HEAD_BYTES} bytes")
        return data[place:]

    def _take_known(self, head: KnownHead, body: bytes) -> None:
        """Take a whole request whose head was parsed before, as `_parse` would."""
        self.on_message_begin()
        self.url, self.scope["http_version"] = head.target, "1.1"
        self.headers.extend(head.headers)
        self.scope["method"], self.scope["path"] = "POST", head.path
        self.scope["raw_path"], self.scope["query_string"] = head.raw_path, head.query
        self.cycle = RequestResponseCycle(
            scope=self.scope,
            transport=self.transport,
            flow=self.flow,
            logger=self.logger,
            access_logger=self.access_logger,
            access_log=self.access_log,
            default_headers=self.server_state.default_headers,
            message_event=asyncio.Event(),
            expect_100_continue=False,
            keep_alive=head.keep_alive,
            on_response=self.on_response_complete,
        )
        self.cycle.body += body
        self.cycle.more_body = False
        self.cycle.message_event.set()
        self._has_begun = False
        self._start_asgi_task(self.cycle, self.app)

    def _ignore_offer(self) -> None:
        """Parse on after a head that offers another protocol: llhttp leaves its body unread.

        A body that is taken for the next request is how requests are smuggled.
        """
        self._unsupported_upgrade_warning()
        if not self._framing:
            return
        framing, self._framing = self._framing, b""
        self.parser = httptools.HttpRequestParser(self)
        self.parser.set_dangerous_leniencies(lenient_data_after_close=True)
        self._is_muted = True
        self.parser.feed_data(b"POST / HTTP/1.1\r\n" + framing + b"\r\n")
        self._is_muted = False

    def _drop_broken(self) -> bool:
        """Forget a queued request whose body is malformed.

        Returns:
            Whether requests before it are still to be answered.
        """
        if self.pipeline and self._is_in_body:
            self.pipeline.popleft()
            self._is_in_body = False
            last = self.pipeline[0][0] if self.pipeline else self._active
            self.cycle = cast(RequestResponseCycle, last)
        return self._is_unanswered

    def _should_upgrade(self) -> bool:
        """No other protocol is served."""
        return False

    def on_message_begin(self) -> None:
        """Begin a request."""
        if not self._is_muted:
            self._has_begun = True
            super().on_message_begin()

    def on_url(self, url: bytes) -> None:
        """Take a part of the target."""
        if not self._is_muted:
            super().on_url(url)

    def on_header(self, name: bytes, value: bytes) -> None:
        """Take a header; trailers are dropped, as they must not pass for headers."""
        if self._is_muted or self._is_in_body:
            return
        # As uvicorn does it, but by one call for each header.
        name, value = name.lower(), value.strip(b" \t")
        if name == b"expect" and value.lower() == b"100-continue":
            self.expect_100_continue = True
        self.headers.append((name, value))

    def on_headers_complete(self) -> None:
        """Have a request answered whose head has arrived."""
        self._unheard = 0
        if self._is_muted:
            return
        check_head(self.parser.get_http_version(), self.url, self.headers)
        if self.parser.should_upgrade():
            lines = [b"%s: %s\r\n" % pair for pair in self.headers if pair[0] in _FRAMING]
            self._framing = b"".join(lines)
        super().on_headers_complete()
        self._has_begun, self._is_in_body = False, True

    def on_body(self, body: bytes) -> None:
        """Take a part of a body."""
        self._unheard = 0
        super().on_body(body)

    def on_message_complete(self) -> None:
        """End a request, unless its body was left unread."""
        self._unheard = 0
        if not self._framing:
            self._is_in_body = False
            super().on_message_complete()

    def _start_asgi_task(self, cycle: RequestResponseCycle, app: Any) -> None:
        self._active = cycle
        if cycle.scope["http_version"] == "1.0":
            app = partial(_answer_unchunked, app, cycle)
        super()._start_asgi_task(cycle, app)


async def _answer_unchunked(
    app: ASGIApp, cycle: RequestResponseCycle, scope: Scope, receive: Receive, send: Send
) -> None:
    """Answer a client of HTTP/1.0: it knows no chunks, the end of the connection ends a body."""
    is_open = False

    async def send_unchunked(message: Message) -> None:
        nonlocal is_open
        if message["type"] == "http.response.start":
            names = {name.lower() for name, _ in message.get("headers", [])}
            is_open = b"content-length" not in names
            if is_open:
                cycle.chunked_encoding = False
        elif is_open:
            cycle.expected_content_length = len(message.get("body", b""))
        await send(message)

    await app(scope, receive, send_unchunked)


def _reason(error: httptools.HttpParserError) -> str:
    """The fault of a request, in words."""
    cause = error.__context__
    reason = str(cause if isinstance(cause, MalformedRequestError) else error)
    if "Content-Length" in reason and "Transfer-Encoding" in reason:
        return "the request has both Content-Length and Transfer-Encoding"
    return reason
