"""The header Idempotency-Key: a POST that creates is answered the same way when it is repeated."""

import hashlib
from collections.abc import Awaitable, Callable
from typing import TypeVar

from fastapi import Request, Response
from starlette.concurrency import run_in_threadpool

from service.access.authentication import caller_of
from service.http.request_headers import FIELDS
from service.http.state import store_of
from service.storage.stores.idempotency_store import IdempotencyKey, KeptAnswer, Recorded
from service.validation import request_problem

_MAX_KEY = 255
#: What is kept: that something was created, or accepted as a job. All else is computed anew.
_KEPT = (201, 202)
_KEPT_HEADERS = ("content-type", "location", "preference-applied")
#: Key in the scope of a request, with the `IdempotencyKey` that it has claimed.
_CLAIMED = "armwright.idempotency_key"

T = TypeVar("T")


async def answer_once(
    request: Request, handle: Callable[[Request], Awaitable[Response]]
) -> Response:
    """Handle a request, or repeat the answer that an earlier one with its key was given.

    Raises:
        ProblemError: The key belongs to another request, or to one still being worked on.
    """
    key = request.scope[FIELDS].get("idempotency-key")
    if key is None or request.method != "POST":
        return await handle(request)
    if not 1 <= len(key) <= _MAX_KEY or not key.isascii() or not key.isprintable():
        raise request_problem(
            "VALIDATION_ERROR",
            f"the header Idempotency-Key must be 1 to {_MAX_KEY} printable ASCII characters",
        )
    answers = store_of(request).answers
    claimed = IdempotencyKey(
        key, f"{request.method} {request.url.path}", caller_of(request.scope).tenant
    )
    body = await request.body()
    digest = (await run_in_threadpool(hashlib.sha256, body)).hexdigest()
    earlier = await run_in_threadpool(answers.begin, claimed, digest)
    if earlier is not None:
        headers = earlier.headers | {"idempotency-replayed": "true"}
        return Response(earlier.body, earlier.status, headers)
    request.scope[_CLAIMED] = claimed
    kept = None
    try:
        response = await handle(request)
        # What a route has stored together with the thing it made is not stored once more.
        if response.status_code in _KEPT and _CLAIMED in request.scope:
            kept = record_of(response)
        return response
    finally:
        try:
            if kept is not None:
                await run_in_threadpool(answers.finish, claimed, kept)
            elif _CLAIMED in request.scope:
                await run_in_threadpool(answers.forget, claimed)
        finally:
            answers.release(claimed)


def kept_answer(request: Request, of: Callable[[T], Response]) -> KeptAnswer[T] | None:
    """The answer that is to be stored in the same transaction as what a request makes.

    A process that dies has then made both or neither. None if the request has no key.

    Args:
        request: Request that makes something.
        of: The answer to it, of what was made.
    """
    key: IdempotencyKey | None = request.scope.get(_CLAIMED)
    return None if key is None else KeptAnswer(key, lambda made: record_of(of(made)))


def note_kept(request: Request) -> None:
    """Note that the answer of a request was stored with what it made."""
    request.scope.pop(_CLAIMED, None)


def record_of(response: Response) -> Recorded:
    """An answer as it is repeated."""
    headers = {n: response.headers[n] for n in _KEPT_HEADERS if n in response.headers}
    return Recorded(response.status_code, headers, bytes(response.body))
