"""Compression of answers for clients that accept it."""

from starlette.middleware.gzip import GZipMiddleware
from starlette.types import Message, Receive, Scope, Send

#: Status of parts of an answer, which are never compressed.
_PARTIAL = 206
_ACCEPT = b"accept-encoding"


class Compression(GZipMiddleware):
    """The framework's middleware, with a short way for answers that stay as they are.

    It holds back the head of each answer, and reads it twice, also where the client accepts no
    compression. All that such an answer needs is the field Vary, as a compressed one has it.
    """

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on."""
        if scope["type"] != "http" or _accepts_gzip(scope):
            await super().__call__(scope, receive, send)
            return

        async def send_with_vary(message: Message) -> None:
            if message["type"] == "http.response.start" and self._varies(message):
                _add_vary(message)
            await send(message)

        await self.app(scope, receive, send_with_vary)

    def _varies(self, message: Message) -> bool:
        """Whether an answer would be compressed for others."""
        if message["status"] == _PARTIAL:
            return False
        for name, value in message.setdefault("headers", []):
            if name == b"content-length" and int(value) < self.minimum_size:
                return False
            if name == b"content-encoding":
                return False
            if name == b"content-type" and self._is_excluded(value.decode("latin-1")):
                return False
        return True

    def _is_excluded(self, content_type: str) -> bool:
        media_type = content_type.partition(";")[0].strip().lower()
        kind = media_type.partition("/")[0] + "/*"
        return media_type in self.exclude_content_types or kind in self.exclude_content_types


def _accepts_gzip(scope: Scope) -> bool:
    return any(name == _ACCEPT and b"gzip" in value for name, value in scope["headers"])


def _add_vary(message: Message) -> None:
    headers = message["headers"] = list(message["headers"])
    for index, (name, value) in enumerate(headers):
        if name == b"vary":
            headers[index] = name, value + b", Accept-Encoding"
            return
    headers.append((b"vary", b"Accept-Encoding"))
