"""A viser server on this machine alone, which refuses pages of other origins."""

from collections.abc import Callable
from http import HTTPStatus
from threading import Lock
from typing import Any
from unittest.mock import patch

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

#: The only address that the studio listens on.
HOST = "127.0.0.1"
#: Names by which a browser on this machine may call it.
_NAMES = (HOST, "localhost")
_REFUSED = "Armwright studio answers its own page on this machine only.\n"

_Handler = Callable[[ServerConnection, Request], Response | None]
#: One server is started at a time: while it starts, a function of websockets is replaced.
_starting = Lock()


def serve_page(port: int) -> viser.ViserServer:
    """Serve the studio's page on 127.0.0.1.

    viser has no setting for origins, and any web page may open a WebSocket to this machine. The
    handshake is therefore guarded: `Host` must name this machine, which also refuses names that a
    foreign domain resolves to 127.0.0.1, and `Origin`, which browsers always send with a
    WebSocket, must be the studio's own.

    Args:
        port: Port to listen on; the next free one if it is taken.
    """
    with _starting, patch.object(websockets.asyncio.server, "serve", _guarded_serve):
        return viser.ViserServer(host=HOST, port=port, label="Armwright studio", verbose=False)


def is_own(host: str | None, origins: list[str]) -> bool:
    """Whether a request comes from the studio's own page or from no page at all.

    Args:
        host: The header `Host`.
        origins: All headers `Origin`; programs that are no browsers send none.
    """
    if host is None or host.rpartition(":")[0] not in _NAMES:
        return False
    return all(origin == f"http://{host}" for origin in origins)


def _guarded_serve(*arguments: Any, **options: Any) -> Any:
    """`websockets.asyncio.server.serve` with the guard before its handler of requests."""
    options["process_request"] = _guard(options["process_request"])
    return _serve(*arguments, **options)


_serve = websockets.asyncio.server.serve


def _guard(handler: _Handler) -> _Handler:
    def guarded(connection: ServerConnection, request: Request) -> Response | None:
        hosts = request.headers.get_all("Host")
        host = hosts[0] if len(hosts) == 1 else None
        if not is_own(host, request.headers.get_all("Origin")):
            headers = Headers({"Content-Type": "text/plain"})
            status = HTTPStatus.FORBIDDEN
            return Response(status, status.phrase, headers, _REFUSED.encode())
        return handler(connection, request)

    return guarded
