"""A real server in a thread, for tests that look at it from outside and from inside."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import httpx
import uvicorn
from fastapi import FastAPI

from tests.service.processes import wait_until

#: Idle connections are closed before a server closes them, after 5 s: a request on its way at that
#: moment would get no answer.
CONNECTIONS = httpx.Limits(keepalive_expiry=2.0)


@contextmanager
def serving(app: FastAPI, **options: Any) -> Iterator[httpx.Client]:
    """Serve an application on a free port; gives a client once it is ready.

    Args:
        app: the application.
        options: of `uvicorn.Config`.
    """
    config = uvicorn.Config(
        app, port=0, log_level="warning", timeout_graceful_shutdown=1, **options
    )
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        assert wait_until(lambda: server.started, 60.0)
        port = server.servers[0].sockets[0].getsockname()[1]
        url = f"http://127.0.0.1:{port}"
        with httpx.Client(base_url=url, timeout=60.0, limits=CONNECTIONS) as client:
            assert wait_until(lambda: client.get("/readyz").status_code == 200, 90.0)
            yield client
    finally:
        server.should_exit = True
        thread.join()
