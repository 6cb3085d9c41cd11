"""The layers around every request, from the outermost to the application."""

import logging

from fastapi import FastAPI
from starlette.middleware.cors import CORSMiddleware

from service.http.access_check import AccessCheck
from service.http.body_limit import BodyLimit
from service.http.compression import Compression
from service.http.direct_routes import DirectRoutes
from service.http.handlers import UnexpectedErrors
from service.http.host_check import HostCheck
from service.http.metrics import Measured, Metrics
from service.http.request_log import RequestLog
from service.http.security_headers import SecurityHeaders
from service.settings import Settings

#: Answers from this size on are compressed for clients that accept gzip [B].
COMPRESSED_SIZE = 4096
#: Answers from this size on are compressed in a thread [B]: shorter ones take less than a
#: millisecond, in which nobody else is answered.
_THREAD_SIZE = 32 * 1024
#: Level of compression: higher ones take several times as long for a few per cent.
_LEVEL = 1
#: Headers of answers that pages of other origins may read.
_EXPOSED = [
    "ETag", "Location", "Retry-After", "Preference-Applied", "Idempotency-Replayed",
    "WWW-Authenticate", "RateLimit-Limit", "RateLimit-Remaining", "RateLimit-Reset",
]  # fmt: skip
#: Headers of requests that pages of other origins may send.
_SENT = [
    "Authorization", "Content-Type", "Idempotency-Key", "If-Match", "If-None-Match", "Prefer",
    "X-API-Key",
]  # fmt: skip


def install(app: FastAPI, settings: Settings, metrics: Metrics) -> None:
    """Put the layers around an application.

    Args:
        app: The application.
        settings: Limits, hosts and origins.
        metrics: What counts the requests.
    """
    # The last one added is the outermost.
    app.add_middleware(DirectRoutes, application=app)
    app.add_middleware(
        Compression,
        minimum_size=COMPRESSED_SIZE,
        compresslevel=_LEVEL,
        thread_minimum_size=_THREAD_SIZE,
    )
    app.add_middleware(
        BodyLimit,
        max_size=settings.max_body_size,
        silence=settings.body_timeout,
        deadline=settings.body_deadline,
    )
    app.add_middleware(AccessCheck, application=app, settings=settings)
    app.add_middleware(HostCheck, names=settings.host_names, origins=settings.origins)
    app.add_middleware(UnexpectedErrors)
    if settings.origins:
        app.add_middleware(
            CORSMiddleware,
            allow_origins=list(settings.origins),
            allow_methods=["GET", "POST", "PUT", "PATCH", "DELETE"],
            allow_headers=_SENT,
            expose_headers=_EXPOSED,
        )
    app.add_middleware(Measured, metrics=metrics)
    app.add_middleware(SecurityHeaders)
    level = logging.INFO if settings.log_requests else logging.WARNING
    logging.getLogger("service.requests").setLevel(level)
    app.add_middleware(RequestLog)
