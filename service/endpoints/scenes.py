"""Scenes by name."""

from datetime import UTC, datetime
from typing import Any, cast

from fastapi import Request, Response
from starlette.concurrency import run_in_threadpool

from armwright_wire.scenes.scene import (
    NamedScene,
    ProjectAnswer,
    ProjectRequest,
    Scene,
    SceneList,
    SceneSummary,
)
from service.endpoints import documents
from service.endpoints.documents import After, Limit
from service.http import answers
from service.http.json_route import json_router
from service.http.request_headers import check_precondition
from service.http.state import prepared_folder
from service.storage.caches import prepared_files
from service.storage.caches.cache_key import Reference
from service.storage.stores.document_store import Record
from service.task_references import make_scene
from service.task_references import project as project_task
from service.validation import ProblemError, validate_as

router = json_router("scenes", "/v1/scenes")

_KIND = "scene"
_CREATED: dict[int | str, dict[str, Any]] = {
    201: {"model": SceneSummary, "description": "Stored as a new scene"}
}


@router.post(
    "/{name}/project", summary="Project points onto the obstacles", response_model=ProjectAnswer
)
async def project(name: str, _body: ProjectRequest, request: Request) -> Response:
    """For each point and obstacle the nearest point of the obstacle's surface, and how far it is.

    The distance is negative inside; margins are no part of an obstacle here.
    """
    content = await request.body()
    result = await answers.answer(
        request, lambda _, scene: project_task.job(cast(Reference, scene), content), None, name
    )
    return answers.json_answer(result)


@router.post("", status_code=201, summary="Store a new scene", response_model=SceneSummary)
async def create_scene(body: NamedScene, request: Request) -> Response:
    """Checks the scene and stores it under its name, which must be free."""
    content = await _build_document(request, body.name)
    return await documents.create(request, _KIND, body.name, content, _summary)


@router.get("", summary="List scenes")
async def list_scenes(request: Request, after: After = "", limit: Limit = 100) -> SceneList:
    """The stored scenes by name, page by page."""
    stored = await documents.stored(request, _KIND, after, limit)
    records, following = documents.page(stored, limit, lambda record: record.name)
    return SceneList(scenes=[_summary(record) for record in records], next=following)


@router.get("/{name}", summary="Get a scene", response_model=NamedScene)
async def get_scene(name: str, request: Request) -> Response:
    """The scene as it was stored; the header ETag changes whenever it is replaced."""
    return await documents.get(request, _KIND, name)


@router.put("/{name}", summary="Store or replace a scene", responses=_CREATED)
async def put_scene(name: str, body: Scene, request: Request, response: Response) -> SceneSummary:
    """Checks the scene and stores it under the name in the path; 201 if there was none."""
    documents.check_name(body.name, name)
    validate_as(NamedScene, {"obstacles": [], "name": name})
    before = await _prepared_reference(request, name)
    check_precondition(request, None if before is None else before.hash)
    content = await _build_document(request, name)
    before = await _prepared_reference(request, name)
    record = await documents.replace(request, response, _KIND, name, content)
    if before is not None and before.hash != record.hash:
        await run_in_threadpool(prepared_files.forget, before)
    return _summary(record)


@router.delete("/{name}", status_code=204, summary="Delete a scene")
async def delete_scene(name: str, request: Request) -> None:
    """Forgets the scene."""
    before = await _prepared_reference(request, name)
    await documents.delete(request, _KIND, name)
    if before is not None:
        await run_in_threadpool(prepared_files.forget, before)


async def _build_document(request: Request, name: str) -> bytes:
    """The document of a scene that a worker has built from the request."""
    content = await request.body()
    job = make_scene.job(content, prepared_folder(request), name)
    return await answers.build(request, job)


async def _prepared_reference(request: Request, name: str) -> Reference | None:
    """Reference of the prepared scene of a name; None where there is none."""
    try:
        return await answers.scene(request, name)
    except ProblemError:
        return None


def _summary(record: Record) -> SceneSummary:
    created = datetime.fromtimestamp(record.created, UTC).isoformat()
    return SceneSummary(**documents.summary_fields(record), created=created)
