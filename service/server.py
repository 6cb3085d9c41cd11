"""The server: the application on a socket, until a signal ends it."""

import asyncio
import ipaddress
import signal
import socket
import sys
from collections.abc import Mapping
from typing import Any

import uvicorn
from fastapi import FastAPI
from pydantic import ValidationError

from service import logs
from service.app import create_app
from service.housekeeping import take_one_arena
from service.http.layer.connection import (
    ConnectionLimits,
    connection_class,
    possible_connections,
)
from service.jobs.engine import require_engine
from service.keys_command import make_first_key
from service.settings import Settings
from service.storage.database import StoreError
from service.storage.store import open_store
from service.tracing.extra import TelemetryMissing, require_telemetry
from service.workers.fork.launch import Launched

#: After SIGTERM requests may go on for this long, then they are told that the service ends [s].
_DRAIN = 2.0
#: And this much later connections that are still open, such as event streams, are cut [s].
_CUT_OFF = 4
#: Longest message of a WebSocket [byte]: it is read on the event loop.
_MESSAGE_BYTES = 2**20


class _Server(uvicorn.Server):
    """Says where it listens, and ends within seconds whatever is still going on."""

    def __init__(self, config: uvicorn.Config, app: FastAPI, greeting: str) -> None:
        super().__init__(config)
        self._application = app
        self._greeting = greeting

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started:
            print(self._greeting, flush=True)  # noqa: T201

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        supervisor = self._application.state.supervisor
        self._application.state.stopping = True
        # Open event streams end now, and what runs as a job goes on when the service is back.
        await self._application.state.jobs.stop()
        asyncio.get_running_loop().call_later(_DRAIN, supervisor.abandon)
        await super().shutdown(sockets)


def serve(
    options: Mapping[str, Any], launched: Launched | None = None, *, is_agent: bool = False
) -> int:
    """Serve until SIGTERM or SIGINT and give the exit code.

    Args:
        options: Settings that win over those of the environment.
        launched: A fork server for `create_app` that was started already.
        is_agent: Whether to work on jobs for agents, and to answer for health and metrics only.
    """
    try:
        settings = Settings(**options)
        if is_agent or settings.jobs != "server":
            require_engine(settings.storage_url)
        require_telemetry(settings.traces)
        # Storage that can't be used is reported here in a sentence, not by the framework.
        store = open_store(settings.storage_url, exclusive=True)
        try:
            listener = _listen(settings.host, settings.port)
            is_safe = is_agent or settings.insecure or _is_local(listener)
            made = make_first_key(store, settings, is_needed=not is_safe)
        finally:
            store.close()
    except ValidationError as error:
        return _refuse("; ".join(f"{_name(e['loc'])}: {e['msg']}" for e in error.errors()))
    except (StoreError, TelemetryMissing) as error:
        return _refuse(str(error))
    except OSError as error:
        return _refuse(f"can't listen on {settings.host} port {settings.port}: {error}")
    logs.configure(settings.log_format)
    take_one_arena()
    app = create_app(settings, launched, is_agent=is_agent)
    config = uvicorn.Config(
        app,
        log_level=settings.log_level,
        log_config=None,
        access_log=settings.log_level == "debug",
        timeout_graceful_shutdown=_CUT_OFF,
        server_header=False,
        lifespan="on",
        http=_protocol(settings),
        ws_max_size=_MESSAGE_BYTES,
    )
    # Raised once more by uvicorn after a graceful end, which is no failure.
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: sys.exit(0))
    serves = "works on jobs; its health and metrics are" if is_agent else "serves"
    greeting = f"Armwright {serves} on {_address(listener)}"
    server = _Server(config, app, greeting if made is None else f"{made}\n{greeting}")
    server.run([listener])
    # The log says why it could not start; whatever started it may try again.
    return 0 if server.started else 1


def _protocol(settings: Settings) -> Any:
    """The protocol of connections, as uvicorn takes it; the types it names are narrower."""
    count = possible_connections(settings.connection_limit)
    return connection_class(ConnectionLimits(count, settings.head_timeout))


def _listen(host: str, port: int) -> socket.socket:
    family, kind, protocol, _, address = socket.getaddrinfo(
        host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
    )[0]
    listener = socket.socket(family, kind, protocol)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
    except OSError:
        listener.close()
        raise
    return listener


def _is_local(listener: socket.socket) -> bool:
    """Whether only this machine reaches a socket."""
    return ipaddress.ip_address(listener.getsockname()[0].partition("%")[0]).is_loopback


def _address(listener: socket.socket) -> str:
    host, port = listener.getsockname()[:2]
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def _name(location: tuple[int | str, ...]) -> str:
    return ".".join(str(step) for step in location) or "settings"


def _refuse(reason: str) -> int:
    print(f"armwright: {reason}", file=sys.stderr)  # noqa: T201
    return 1
