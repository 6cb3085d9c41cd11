"""Compression of answers for clients that accept it."""

import re
from collections.abc import Collection

from starlette.middleware.gzip import GZipMiddleware
from starlette.types import Message, Receive, Scope, Send

#: Status of parts of an answer, which are never compressed.
_PARTIAL = 206
_ACCEPT = b"accept-encoding"
#: The quality of what is not accepted.
_REFUSED = re.compile(rb"q=0(\.0{0,3})?")


class Compression(GZipMiddleware):
    """The framework's middleware, with a short way for answers that stay as they are.

    It holds back the head of each answer, and reads it twice, also where the client accepts no
    compression. All that such an answer needs is the field Vary, as a compressed one has it.
    """

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on."""
        if scope["type"] != "http" or accepts_gzip(scope):
            await super().__call__(scope, receive, send)
            return

        async def send_with_vary(message: Message) -> None:
            if message["type"] == "http.response.start":
                add_vary(message, self.minimum_size, self.exclude_content_types)
            await send(message)

        await self.app(scope, receive, send_with_vary)


def add_vary(message: Message, minimum_size: int, excluded: Collection[str]) -> None:
    """Have the head of an answer that is not compressed say that it would be for others.

    Args:
        message: The head.
        minimum_size: Of answers that are compressed [byte].
        excluded: Types of content that never are.
    """
    if message["status"] == _PARTIAL:
        return
    for name, value in message.setdefault("headers", []):
        if name == b"content-length" and int(value) < minimum_size:
            return
        if name == b"content-encoding":
            return
        if name == b"content-type" and _is_among(value.decode("latin-1"), excluded):
            return
    _add_vary(message)


def _is_among(content_type: str, excluded: Collection[str]) -> bool:
    media_type = content_type.partition(";")[0].strip().lower()
    kind = media_type.partition("/")[0] + "/*"
    return media_type in excluded or kind in excluded


def accepts_gzip(scope: Scope) -> bool:
    """Whether the client of a request accepts answers that are compressed."""
    return any(name == _ACCEPT and _takes_gzip(value) for name, value in scope["headers"])


def _takes_gzip(accepted: bytes) -> bool:
    """Whether a field Accept-Encoding names gzip, and not with the quality 0."""
    if b"gzip" not in accepted:
        return False
    for choice in accepted.split(b","):
        name, *parameters = choice.replace(b" ", b"").lower().split(b";")
        if name == b"gzip":
            return not any(_REFUSED.fullmatch(parameter) for parameter in parameters)
    return False


def _add_vary(message: Message) -> None:
    headers = message["headers"] = list(message["headers"])
    for index, (name, value) in enumerate(headers):
        if name == b"vary":
            headers[index] = name, value + b", Accept-Encoding"
            return
    headers.append((b"vary", b"Accept-Encoding"))
