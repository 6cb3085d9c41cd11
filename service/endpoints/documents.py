"""Robots, scenes and tools as documents: stored, listed page by page, replaced and deleted."""

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import partial
from typing import Annotated, Any, TypeVar

from fastapi import Query, Request, Response
from pydantic import BaseModel
from starlette.concurrency import run_in_threadpool

from service.http.answers import json_answer
from service.http.idempotency import kept_answer, note_kept
from service.http.request_headers import check_precondition
from service.http.state import documents_of
from service.storage.stores.document_store import Record
from service.validation import request_problem

_T = TypeVar("_T")

#: Query of a list by names.
After = Annotated[str, Query(max_length=256, description="names that sort after this")]
Limit = Annotated[int, Query(ge=1, le=1000)]


def page(
    items: Sequence[_T], limit: int, key: Callable[[_T], str]
) -> tuple[Sequence[_T], str | None]:
    """The items of a page, and the key after which the next page begins.

    Args:
        items: Items in order, one more than the page holds where there is a next page.
        limit: Items of a page.
        key: Key of an item.

    Returns:
        The first items, and the key of the last one, None where nothing follows.
    """
    following = key(items[limit - 1]) if len(items) > limit else None
    return items[:limit], following


async def create(
    request: Request,
    kind: str,
    name: str,
    content: bytes,
    answer: Callable[[Record], BaseModel | bytes],
) -> Response:
    """Response to a request that stores a new document, kept with it for its idempotency key.

    Args:
        request: Request on whose behalf.
        kind: Kind of document.
        name: Name of the document.
        content: Content of the document.
        answer: Answer that tells of it, a model or JSON.

    Raises:
        ProblemError: CONFLICT, the name is taken; QUOTA_EXCEEDED.
    """

    def created(record: Record) -> Response:
        headers = {"Location": f"/v1/{kind}s/{record.name}"}
        made = answer(record)
        content = made if isinstance(made, bytes) else made.model_dump_json()
        return Response(content, 201, headers, "application/json")

    told = kept_answer(request, created)
    documents = documents_of(request)
    record = await run_in_threadpool(documents.create, kind, name, content, told)
    note_kept(request)
    return created(record)


async def stored(request: Request, kind: str, after: str, limit: int) -> list[Record]:
    """The documents of a page by name, and the one behind it."""
    return await run_in_threadpool(documents_of(request).list, kind, after, limit + 1)


async def get(request: Request, kind: str, name: str) -> Response:
    """Response with a document as it was stored, and its tag.

    Raises:
        ProblemError: NOT_FOUND.
    """
    document = await run_in_threadpool(documents_of(request).get, kind, name)
    response = json_answer(document.content)
    response.headers["ETag"] = f'"{document.record.hash}"'
    return response


def check_name(given: str | None, name: str) -> None:
    """Check that a body names what its path does, or nothing.

    Raises:
        ProblemError: VALIDATION_ERROR.
    """
    if given not in (None, name):
        raise request_problem(
            "VALIDATION_ERROR",
            f"name: {given!r} in the body, but {name!r} in the path",
            hint="Leave the name out of the body.",
        )


async def replace(
    request: Request, response: Response, kind: str, name: str, content: bytes
) -> Record:
    """Store a document, new or in place of the one of its name, and say which in the response.

    Raises:
        ProblemError: QUOTA_EXCEEDED; PRECONDITION_FAILED.
    """
    # Asked in the transaction that stores it: it may have been replaced meanwhile.
    precondition = partial(check_precondition, request)
    documents = documents_of(request)
    record = await run_in_threadpool(documents.replace, kind, name, content, precondition)
    if record.version == 1:
        response.status_code = 201
        response.headers["Location"] = f"/v1/{kind}s/{name}"
    return record


async def delete(request: Request, kind: str, name: str) -> None:
    """Forget a document.

    Raises:
        ProblemError: NOT_FOUND; PRECONDITION_FAILED.
    """
    precondition = partial(check_precondition, request)
    await run_in_threadpool(documents_of(request).delete, kind, name, precondition)


def summary_fields(record: Record) -> dict[str, Any]:
    """Fields of a summary that documents have in common."""
    updated = datetime.fromtimestamp(record.updated, UTC).isoformat()
    return {"name": record.name, "hash": record.hash, "version": record.version, "updated": updated}
