"""Scenes by name."""

from datetime import UTC, datetime
from functools import partial
from typing import Annotated, Any, cast

from fastapi import Query, Request, Response
from starlette.concurrency import run_in_threadpool

from armwright_wire.scenes.scene import (
    NamedScene,
    ProjectAnswer,
    ProjectRequest,
    Scene,
    SceneList,
    SceneSummary,
)
from service.endpoints.paging import page
from service.http import answers
from service.http.idempotency import kept_answer, note_kept
from service.http.json_route import json_router
from service.http.request_headers import check_precondition
from service.http.state import documents_of, prepared_folder
from service.problem import ProblemError, request_problem
from service.storage.caches import prepared_files
from service.storage.caches.cache_key import Reference
from service.storage.stores.document_store import Record
from service.task_references import make_scene
from service.task_references import project as project_task
from service.validation import validate_as

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
    told = kept_answer(request, _created)
    documents = documents_of(request)
    record = await run_in_threadpool(documents.create, _KIND, body.name, content, told)
    note_kept(request)
    return _created(record)


@router.get("", summary="List scenes")
async def list_scenes(
    request: Request,
    after: Annotated[str, Query(max_length=256, description="names that sort after this")] = "",
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
) -> SceneList:
    """The stored scenes by name, page by page."""
    stored = await run_in_threadpool(documents_of(request).list, _KIND, after, limit + 1)
    records, following = page(stored, limit, lambda record: record.name)
    return SceneList(scenes=[_summary(record) for record in records], next=following)


@router.get("/{name}", summary="Get a scene", response_model=NamedScene)
async def get_scene(name: str, request: Request) -> Response:
    """The scene as it was stored; the header ETag changes whenever it is replaced."""
    document = await run_in_threadpool(documents_of(request).get, _KIND, name)
    headers = {"ETag": f'"{document.record.hash}"'}
    return Response(document.content, headers=headers, media_type="application/json")


@router.put("/{name}", summary="Store or replace a scene", responses=_CREATED)
async def put_scene(name: str, body: Scene, request: Request, response: Response) -> SceneSummary:
    """Checks the scene and stores it under the name in the path; 201 if there was none."""
    if body.name not in (None, name):
        raise request_problem(
            "VALIDATION_ERROR",
            f"name: {body.name!r} in the body, but {name!r} in the path",
            hint="Leave the name out of the body.",
        )
    validate_as(NamedScene, {"obstacles": [], "name": name})
    check_precondition(request, _hash(await _prepared_reference(request, name)))
    content = await _build_document(request, name)
    before = await _prepared_reference(request, name)
    # Asked once more in the transaction that stores it: it may have been replaced meanwhile.
    precondition = partial(check_precondition, request)
    record = await run_in_threadpool(
        documents_of(request).replace, _KIND, name, content, precondition
    )
    if before is not None and before.hash != record.hash:
        await run_in_threadpool(prepared_files.forget, before)
    if record.version == 1:
        response.status_code = 201
        response.headers["Location"] = f"/v1/scenes/{name}"
    return _summary(record)


@router.delete("/{name}", status_code=204, summary="Delete a scene")
async def delete_scene(name: str, request: Request) -> None:
    """Forgets the scene."""
    before = await _prepared_reference(request, name)
    precondition = partial(check_precondition, request)
    await run_in_threadpool(documents_of(request).delete, _KIND, name, precondition)
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


def _hash(reference: Reference | None) -> str | None:
    return None if reference is None else reference.hash


def _created(record: Record) -> Response:
    content = _summary(record).model_dump_json().encode()
    headers = {"Location": f"/v1/scenes/{record.name}"}
    return Response(content, 201, headers, "application/json")


def _summary(record: Record) -> SceneSummary:
    return SceneSummary(
        name=record.name,
        hash=record.hash,
        version=record.version,
        created=_iso(record.created),
        updated=_iso(record.updated),
    )


def _iso(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).isoformat()
