"""Responses read by llhttp, the parser of Node.js: a third of the standard library's time.

It comes with the package httptools, where that is installed (``armwright-client[llhttp]``).
"""

import http.client
import socket
from collections.abc import Iterator

import httptools

#: Read at a time [byte]: nearly all answers fit.
_PART_BYTES = 64 * 1024
#: A head beyond this is refused [byte], and one of more fields than this, as the standard library
#: does it.
_HEAD_BYTES = 256 * 1024
_FIELDS = 100
#: Statuses below this, but one, come before the response itself.
_FINAL, _SWITCHING = 200, 101


class Fields:
    """Headers of a response, in their order."""

    def __init__(self) -> None:
        self._fields: list[tuple[bytes, bytes]] = []

    def add(self, name: bytes, value: bytes) -> None:
        """Add a header, which is decoded when somebody asks for it: most are never asked for."""
        self._fields.append((name, value))

    def get(self, name: str, default: str | None = None) -> str | None:
        """The first value of a header."""
        sought = name.lower().encode("latin-1")
        for known, value in self._fields:
            if len(known) == len(sought) and known.lower() == sought:
                return value.decode("latin-1").strip()
        return default

    def items(self) -> Iterator[tuple[str, str]]:
        """All names, in lower case, and values."""
        for name, value in self._fields:
            yield name.decode("latin-1").lower(), value.decode("latin-1").strip()

    def __len__(self) -> int:
        return len(self._fields)


class ParsedResponse:
    """A response as `http.client.HTTPConnection` has one, read to its end where it begins.

    Args:
        sock: Where it comes.
        debuglevel: Not used.
        method: Of the request.
        url: Not used.
    """

    def __init__(
        self,
        sock: socket.socket,
        debuglevel: int = 0,  # noqa: ARG002
        method: str | None = None,
        url: str | None = None,  # noqa: ARG002
    ) -> None:
        self._socket = sock
        self._has_no_body = method == "HEAD"
        self._parser = httptools.HttpResponseParser(self)
        self._is_head_read = self._is_complete = False
        self._parts: list[bytes] = []
        self.headers = Fields()
        self.status = 0
        self.will_close = True

    def begin(self) -> None:
        """Read the response.

        Raises:
            HTTPException: It is no HTTP, or ends early.
            OSError: The connection broke, or nothing came in time.
        """
        unheard, has_begun = 0, False
        while not self._is_complete:
            data = self._socket.recv(_PART_BYTES)
            if not data:
                self._end(has_begun=has_begun)
                return
            has_begun = True
            unheard += 0 if self._is_head_read else len(data)
            try:
                self._parser.feed_data(data)
            except (httptools.HttpParserError, httptools.HttpParserUpgrade) as error:
                if not self._is_complete:
                    raise http.client.BadStatusLine(f"no HTTP: {error}") from error
                self.will_close = True
            if unheard > _HEAD_BYTES or len(self.headers) > _FIELDS:
                raise http.client.HTTPException("the head of the response is too long")

    def _end(self, *, has_begun: bool) -> None:
        """Take the end of the connection for that of the response, if nothing else ends it."""
        if not has_begun:
            raise http.client.RemoteDisconnected("the connection was closed without a response")
        is_told = any(
            self.headers.get(name) is not None for name in ("content-length", "transfer-encoding")
        )
        if is_told or not self._is_head_read:
            raise http.client.IncompleteRead(self.read())

    def on_message_begin(self) -> None:
        """Begin a message; what follows a response that is complete was not asked for."""
        if self._is_complete:
            self.will_close = True

    def on_header(self, name: bytes, value: bytes) -> None:
        """Take a header; those behind the body are passed over."""
        if not self._is_head_read:
            self.headers.add(name, value)

    def on_headers_complete(self) -> None:
        """End the head."""
        self.status = self._parser.get_status_code()
        if self.status >= _FINAL or self.status == _SWITCHING:
            self._is_head_read = True
            if self._has_no_body:
                self._is_complete = True

    def on_body(self, body: bytes) -> None:
        """Take a part of the body."""
        self._parts.append(body)

    def on_message_complete(self) -> None:
        """End the response, or what came before it."""
        if self._is_head_read:
            self._is_complete = True
            self.will_close = not self._parser.should_keep_alive()
        else:
            self.headers = Fields()

    def read(self) -> bytes:
        """The body."""
        return b"".join(self._parts)

    def isclosed(self) -> bool:
        """Whether the next request may be sent."""
        return True

    def close(self) -> None:
        """Let go of the connection, which is not the response's."""
