"""The header Idempotency-Key: a POST that creates is answered the same way when it is repeated."""

import hashlib
from collections.abc import Awaitable, Callable

from fastapi import Request, Response
from starlette.concurrency import run_in_threadpool

from service.http.state import store_of
from service.problem import ProblemError
from service.storage.idempotency_store import IdempotencyKey, Recorded

_MAX_KEY = 255
#: What is kept: that something was created, or accepted as a job. All else is computed anew.
_KEPT = (201, 202)
_KEPT_HEADERS = ("content-type", "location", "preference-applied")


async def answer_once(
    request: Request, handle: Callable[[Request], Awaitable[Response]]
) -> Response:
    """Handle a request, or repeat the answer that an earlier one with its key was given.

    Raises:
        ProblemError: The key belongs to another request, or to one still being worked on.
    """
    key = request.headers.get("idempotency-key")
    if key is None or request.method != "POST":
        return await handle(request)
    if not 1 <= len(key) <= _MAX_KEY or not key.isascii() or not key.isprintable():
        raise ProblemError(
            "VALIDATION_ERROR",
            f"the header Idempotency-Key must be 1 to {_MAX_KEY} printable ASCII characters",
            stage="request",
        )
    store = store_of(request).answers
    claimed = IdempotencyKey(key, f"{request.method} {request.url.path}")
    body = await request.body()
    digest = (await run_in_threadpool(hashlib.sha256, body)).hexdigest()
    earlier = await run_in_threadpool(store.begin, claimed, digest)
    if earlier is not None:
        return _replay(earlier)
    kept = None
    try:
        response = await handle(request)
        if response.status_code in _KEPT:
            headers = {n: response.headers[n] for n in _KEPT_HEADERS if n in response.headers}
            kept = Recorded(response.status_code, headers, bytes(response.body))
        return response
    finally:
        if kept is None:
            await run_in_threadpool(store.forget, claimed)
        else:
            await run_in_threadpool(store.finish, claimed, kept)


def _replay(earlier: Recorded) -> Response:
    headers = earlier.headers | {"idempotency-replayed": "true"}
    return Response(earlier.body, earlier.status, headers)
