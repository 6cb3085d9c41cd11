"""Heads of requests as the standard library writes them, remembered but for the length of a body.

To write one takes as long as to encode the request; a client sends a few different ones.
"""

import http.client
from collections.abc import Mapping
from typing import Any

#: Heads that are remembered.
_KEPT = 256


class _Writer(http.client.HTTPConnection):
    """A connection that keeps what would be sent."""

    written = b""

    def send(self, data: Any) -> None:
        """Keep some bytes."""
        self.written += data


class RequestHeads:
    """Heads of requests to one service.

    Args:
        host: Of the service.
        port: Of the service; None for the default.
        default_port: Of the scheme, which is not named in the header Host.
    """

    def __init__(self, host: str, port: int | None, default_port: int) -> None:
        self._writer = host, default_port if port is None else port
        self._default_port = default_port
        self._kept: dict[tuple[Any, ...], tuple[bytes, bytes]] = {}

    def head(
        self, method: str, target: str, headers: Mapping[str, str], content: bytes | None
    ) -> bytes:
        """The head of a request, with the empty line that ends it.

        Args:
            method: Of HTTP.
            target: What is asked for.
            headers: Of the request.
            content: Its body, if it has one.

        Raises:
            ValueError: Something in it can't be sent.
        """
        if not content:
            return self._written(method, target, headers, content)
        key = method, target, *headers.items()
        found = self._kept.get(key)
        if found is None:
            before, _, after = self._written(method, target, headers, content).partition(
                b"\r\nContent-Length: %d\r\n" % len(content)
            )
            if len(self._kept) >= _KEPT:
                self._kept.clear()
            found = self._kept[key] = before + b"\r\nContent-Length: ", b"\r\n" + after
        return b"%b%d%b" % (found[0], len(content), found[1])

    def _written(
        self, method: str, target: str, headers: Mapping[str, str], content: bytes | None
    ) -> bytes:
        writer = _Writer(*self._writer)
        writer.default_port = self._default_port
        writer.request(method, target, content, headers)
        return writer.written[: len(writer.written) - len(content or b"")]
