"""Tools by name: what robots work with."""

from datetime import UTC, datetime
from functools import partial
from typing import Annotated, Any

from fastapi import Query, Request, Response
from starlette.concurrency import run_in_threadpool

from armwright_wire.scenes.tool import BUILTIN_TOOLS, NamedTool, Tool, ToolList, ToolSummary
from service.endpoints.paging import page
from service.http import answers
from service.http.idempotency import kept_answer, note_kept
from service.http.json_route import json_router
from service.http.request_headers import check_precondition
from service.http.state import documents_of
from service.problem import request_problem, storage_problem
from service.storage.caches.mounts import builtin_tool
from service.storage.stores.document_store import Record
from service.task_references import make_tool
from service.validation import validate_as

router = json_router("tools", "/v1/tools")

_KIND = "tool"
_CREATED: dict[int | str, dict[str, Any]] = {
    201: {"model": ToolSummary, "description": "Stored as a new tool"}
}


@router.post("", status_code=201, summary="Store a new tool", response_model=ToolSummary)
async def create_tool(body: NamedTool, request: Request) -> Response:
    """Checks the tool and stores it under its name, which must be free.

    Requests that name it in `tool` work with it: its tip is the robot's, its solids collide, its
    mass counts for torques.
    """
    _check_free(body.name)
    content = await answers.build(request, make_tool.job(await request.body(), body.name))
    told = kept_answer(request, _created)
    documents = documents_of(request)
    record = await run_in_threadpool(documents.create, _KIND, body.name, content, told)
    note_kept(request)
    return _created(record)


@router.get("", summary="List tools")
async def list_tools(
    request: Request,
    after: Annotated[str, Query(max_length=256, description="names that sort after this")] = "",
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
) -> ToolList:
    """Built-in and stored tools by name, page by page."""
    stored = await run_in_threadpool(documents_of(request).list, _KIND, after, limit + 1)
    every = [_summary(record) for record in stored]
    every += [ToolSummary(name=name, built_in=True) for name in BUILTIN_TOOLS if name > after]
    tools, following = page(sorted(every, key=_name), limit, _name)
    return ToolList(tools=tools, next=following)


@router.get("/{name}", summary="Get a tool", response_model=NamedTool)
async def get_tool(name: str, request: Request) -> Response:
    """The tool as it was stored; the header ETag changes whenever it is replaced."""
    content, headers = builtin_tool(name), None
    if content is None:
        document = await run_in_threadpool(documents_of(request).get, _KIND, name)
        content, headers = document.content, {"ETag": f'"{document.record.hash}"'}
    return Response(content, headers=headers, media_type="application/json")


@router.put("/{name}", summary="Store or replace a tool", responses=_CREATED)
async def put_tool(name: str, body: Tool, request: Request, response: Response) -> ToolSummary:
    """Checks the tool and stores it under the name in the path; 201 if there was none."""
    if body.name not in (None, name):
        raise request_problem(
            "VALIDATION_ERROR",
            f"name: {body.name!r} in the body, but {name!r} in the path",
            hint="Leave the name out of the body.",
        )
    validate_as(NamedTool, {"form": {"type": "torch"}, "name": name})
    _check_free(name)
    content = await answers.build(request, make_tool.job(await request.body(), name))
    # Asked in the transaction that stores it.
    precondition = partial(check_precondition, request)
    record = await run_in_threadpool(
        documents_of(request).replace, _KIND, name, content, precondition
    )
    if record.version == 1:
        response.status_code = 201
        response.headers["Location"] = f"/v1/tools/{name}"
    return _summary(record)


@router.delete("/{name}", status_code=204, summary="Delete a tool")
async def delete_tool(name: str, request: Request) -> None:
    """Forgets the tool; kept plans hold it as it was."""
    _check_free(name)
    precondition = partial(check_precondition, request)
    await run_in_threadpool(documents_of(request).delete, _KIND, name, precondition)


def _check_free(name: str) -> None:
    """Refuse to change a built-in tool.

    Raises:
        ProblemError: CONFLICT.
    """
    if name in BUILTIN_TOOLS:
        raise storage_problem(
            "CONFLICT",
            f"{name!r} is the name of a built-in tool",
            hint='Choose another name; "form" gives it other sizes.',
        )


def _created(record: Record) -> Response:
    content = _summary(record).model_dump_json().encode()
    headers = {"Location": f"/v1/tools/{record.name}"}
    return Response(content, 201, headers, "application/json")


def _name(summary: ToolSummary) -> str:
    return summary.name


def _summary(record: Record) -> ToolSummary:
    updated = datetime.fromtimestamp(record.updated, UTC).isoformat()
    return ToolSummary(
        name=record.name, built_in=False, hash=record.hash, version=record.version, updated=updated
    )
