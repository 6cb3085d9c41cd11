"""Requests that are simple and have come in whole: they are read and answered without h11.

h11 reads anything that is HTTP, in Python; it takes a tenth of the time that the server has for a
plan. Nearly all requests are of one form, which a few patterns tell. What does not match them goes
to h11 as before, so nothing is read here that h11 would refuse or read otherwise.
"""

import re
from dataclasses import dataclass

from uvicorn._types import ASGIReceiveEvent, ASGISendEvent
from uvicorn.protocols.http.h11_impl import STATUS_PHRASES, RequestResponseCycle

_REQUEST_LINE = re.compile(rb"POST (/v1/[A-Za-z0-9/_.\-]+) HTTP/1\.1")
#: A header field (RFC 9110, 5.5) with visible ASCII as its value, and single blanks within.
_FIELD = re.compile(rb"([!#$%&'*+\-.^_`|~0-9A-Za-z]+):[ \t]?([\x21-\x7e]+(?:[ \t][\x21-\x7e]+)*)")
_LENGTH = re.compile(rb"[0-9]{1,7}")
#: Heads up to this may be simple [byte]; those of real clients have some hundred.
_HEAD_BYTES = 8 * 1024
#: Bodies up to this may be: longer ones don't come in one piece [byte].
BODY_BYTES = 64 * 1024
#: Fields that ask for more than an answer.
_NEGOTIATING = frozenset({b"transfer-encoding", b"expect", b"upgrade", b"te", b"trailer"})
#: Bodies up to this are copied behind the head of their answer, and sent with it [byte].
_JOINED_BYTES = 256 * 1024
_BODILESS = (204, 304)


@dataclass(frozen=True, slots=True)
class SimpleHead:
    """The head of a POST with a body of a length that is told, and nothing negotiated.

    Args:
        path: Its path, ASCII without escapes.
        fields: Its header fields in order, their names in lower case.
        size: Length of the body [byte].
        body_at: Where the body begins in the bytes that were read.
    """

    path: str
    fields: list[tuple[bytes, bytes]]
    size: int
    body_at: int


def read_head(data: bytes) -> SimpleHead | None:
    """The head of the request that some bytes begin with; None unless it is simple."""
    end = data.find(b"\r\n\r\n", 0, _HEAD_BYTES)
    if end < 0:
        return None
    first, *lines = data[:end].split(b"\r\n")
    line = _REQUEST_LINE.fullmatch(first)
    matches = list(map(_FIELD.fullmatch, lines))
    if line is None or None in matches:
        return None
    fields = [(match[1].lower(), match[2]) for match in matches if match is not None]
    values = dict(fields)
    names = [name for name, _ in fields]
    length = values.get(b"content-length", b"")
    if (
        names.count(b"host") != 1
        or names.count(b"content-length") != 1
        or names.count(b"connection") > 1
        or values.get(b"connection", b"keep-alive").lower() != b"keep-alive"
        or not _NEGOTIATING.isdisjoint(names)
        or not _LENGTH.fullmatch(length)
        or int(length) > BODY_BYTES
    ):
        return None
    return SimpleHead(line[1].decode("ascii"), fields, int(length), end + 4)


class SimpleCycle(RequestResponseCycle):
    """The answer to a request whose body is there; sent by the rules of HTTP/1.1 without h11."""

    _head: bytes = b""
    _is_chunked: bool = False

    async def receive(self) -> ASGIReceiveEvent:
        """The body, and after it that the client has left or was answered."""
        if self.more_body:
            self.more_body = False
            return {"type": "http.request", "body": bytes(self.body), "more_body": False}
        if not self.disconnected and not self.response_complete:
            await self.message_event.wait()
        return {"type": "http.disconnect"}

    async def send(self, message: ASGISendEvent) -> None:
        """Send a part of the answer; the head goes out with the first part of the body.

        Raises:
            RuntimeError: It is not the part that is due, or has a line break in a header.
        """
        if self.flow.write_paused and not self.disconnected:
            await self.flow.drain()
        if self.disconnected:
            return
        if message["type"] == "http.response.start" and not self.response_started:
            self.response_started = True
            self._head = self._encode_head(message["status"], list(message.get("headers", [])))
            return
        is_due = self.response_started and not self.response_complete
        if message["type"] != "http.response.body" or not is_due:
            raise RuntimeError(f"the ASGI message {message['type']!r} is not due")
        head, self._head = self._head, b""
        is_last = not message.get("more_body", False)
        self._write(head, self._encode_body(message.get("body", b""), is_last=is_last))
        if is_last:
            self.response_complete = True
            self.message_event.set()
            if not self.keep_alive:
                self.transport.close()
            self.on_response()

    def _encode_head(self, status: int, headers: list[tuple[bytes, bytes]]) -> bytes:
        names = {name.lower() for name, _ in headers}
        self._is_chunked = b"content-length" not in names and status not in _BODILESS
        if self._is_chunked:
            headers.append((b"transfer-encoding", b"chunked"))
        if (b"connection", b"close") in ((n.lower(), v.lower()) for n, v in headers):
            self.keep_alive = False
        elif not self.keep_alive:
            headers.append((b"connection", b"close"))
        lines = [b"HTTP/1.1 %d " % status + STATUS_PHRASES[status]]
        lines += [b"%b: %b" % field for field in (*self.default_headers, *headers)]
        head = b"\r\n".join([*lines, b"", b""])
        if not head.count(b"\r") == head.count(b"\n") == len(lines) + 1:
            raise RuntimeError("a header has a line break in it")
        return head

    def _encode_body(self, part: bytes, *, is_last: bool) -> bytes:
        if not self._is_chunked:
            return part
        chunk = b"%x\r\n%b\r\n" % (len(part), part) if part else b""
        return chunk + b"0\r\n\r\n" if is_last else chunk

    def _write(self, head: bytes, body: bytes) -> None:
        if len(body) <= _JOINED_BYTES:
            self.transport.write(head + body)
            return
        self.transport.write(head)
        self.transport.write(body)
