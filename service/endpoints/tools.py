"""Tools by name: what robots work with."""

from operator import attrgetter
from typing import Any

from fastapi import Request, Response

from armwright_wire.scenes.tool import BUILTIN_TOOLS, NamedTool, Tool, ToolList, ToolSummary
from service.endpoints import documents
from service.endpoints.documents import After, Limit
from service.http import answers
from service.http.json_route import json_router
from service.storage.caches.mounts import builtin_tool
from service.storage.stores.document_store import Record
from service.task_references import make_tool
from service.validation import storage_problem, validate_as

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
    return await documents.create(request, _KIND, body.name, content, _summary)


@router.get("", summary="List tools")
async def list_tools(request: Request, after: After = "", limit: Limit = 100) -> ToolList:
    """Built-in and stored tools by name, page by page."""
    every = [_summary(record) for record in await documents.stored(request, _KIND, after, limit)]
    every += [ToolSummary(name=name, built_in=True) for name in BUILTIN_TOOLS if name > after]
    every.sort(key=attrgetter("name"))
    tools, following = documents.page(every, limit, attrgetter("name"))
    return ToolList(tools=tools, next=following)


@router.get("/{name}", summary="Get a tool", response_model=NamedTool)
async def get_tool(name: str, request: Request) -> Response:
    """The tool as it was stored; the header ETag changes whenever it is replaced."""
    content = builtin_tool(name)
    if content is not None:
        return answers.json_answer(content)
    return await documents.get(request, _KIND, name)


@router.put("/{name}", summary="Store or replace a tool", responses=_CREATED)
async def put_tool(name: str, body: Tool, request: Request, response: Response) -> ToolSummary:
    """Checks the tool and stores it under the name in the path; 201 if there was none."""
    documents.check_name(body.name, name)
    validate_as(NamedTool, {"form": {"type": "torch"}, "name": name})
    _check_free(name)
    content = await answers.build(request, make_tool.job(await request.body(), name))
    return _summary(await documents.replace(request, response, _KIND, name, content))


@router.delete("/{name}", status_code=204, summary="Delete a tool")
async def delete_tool(name: str, request: Request) -> None:
    """Forgets the tool; kept plans hold it as it was."""
    _check_free(name)
    await documents.delete(request, _KIND, name)


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


def _summary(record: Record) -> ToolSummary:
    return ToolSummary(**documents.summary_fields(record), built_in=False)
