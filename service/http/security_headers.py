"""Headers of every answer that tell browsers to be careful with it."""

from starlette.types import ASGIApp, Message, Receive, Scope, Send

#: Answers are data: nothing in them may be run, shown in a frame or taken for another type.
SECURITY_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
_FIELDS = [(name.lower().encode(), value.encode()) for name, value in SECURITY_HEADERS.items()]
_NAMES = frozenset(name for name, _ in _FIELDS)


class SecurityHeaders:
    """Middleware that adds `SECURITY_HEADERS` to every answer that has not its own.

    Args:
        app: The application behind it.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                add_security_headers(message)
            await send(message)

        await self._app(scope, receive, send_with_headers)


def add_security_headers(message: Message) -> None:
    """Add the headers to the head of an answer that has not its own."""
    headers = message.setdefault("headers", [])
    for name, _ in headers:
        if name in _NAMES:
            own = {name for name, _ in headers}
            message["headers"] = [*headers, *(f for f in _FIELDS if f[0] not in own)]
            return
    message["headers"] = [*headers, *_FIELDS]
