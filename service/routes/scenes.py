"""Scenes by name."""

from datetime import UTC, datetime
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from starlette.concurrency import run_in_threadpool

from service.http.body import JsonRoute
from service.http.errors import ProblemError
from service.http.openapi import RESPONSES
from service.http.validation import validated
from service.schemas.scene import (
    NamedScene,
    ProjectAnswer,
    ProjectRequest,
    Scene,
    SceneList,
    SceneSummary,
)
from service.storage import disk_cache, robot_repository
from service.storage.cache_key import Reference
from service.storage.document_store import Record, Store
from service.workers.main import Job

router = APIRouter(prefix="/v1/scenes", tags=["scenes"], route_class=JsonRoute, responses=RESPONSES)

_KIND = "scene"


@router.post(
    "/{name}/project", summary="Project points onto the obstacles", response_model=ProjectAnswer
)
async def project(name: str, _body: ProjectRequest, request: Request) -> Response:
    """For each point and obstacle the nearest point of the obstacle's surface, and how far it is.

    The distance is negative inside; margins are no part of an obstacle here.
    """
    content = await request.body()
    result = await robot_repository.answer_scene(
        request, lambda scene: Job("service.tasks.check:project", (scene, content)), name
    )
    return Response(result, media_type="application/json")


@router.post("", status_code=201, summary="Store a new scene")
async def create_scene(body: NamedScene, request: Request, response: Response) -> SceneSummary:
    """Checks the scene and stores it under its name, which must be free."""
    content = await _made(request, body.name)
    record = await run_in_threadpool(_store(request).create, _KIND, body.name, content)
    response.headers["Location"] = f"/v1/scenes/{record.name}"
    return _summary(record)


@router.get("", summary="List scenes")
async def list_scenes(
    request: Request,
    after: Annotated[str, Query(max_length=256, description="names that sort after this")] = "",
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
) -> SceneList:
    """The stored scenes by name, page by page."""
    records = await run_in_threadpool(_store(request).list, _KIND, after, limit + 1)
    following = records[limit - 1].name if len(records) > limit else None
    return SceneList(scenes=[_summary(record) for record in records[:limit]], next=following)


@router.get("/{name}", summary="Get a scene", response_model=NamedScene)
async def get_scene(name: str, request: Request) -> Response:
    """The scene as it was stored; the header ETag changes whenever it is replaced."""
    document = await run_in_threadpool(_store(request).get, _KIND, name)
    headers = {"ETag": f'"{document.record.hash}"'}
    return Response(document.content, headers=headers, media_type="application/json")


@router.put("/{name}", summary="Store or replace a scene")
async def put_scene(name: str, body: Scene, request: Request, response: Response) -> SceneSummary:
    """Checks the scene and stores it under the name in the path; 201 if there was none."""
    if body.name not in (None, name):
        raise ProblemError(
            "VALIDATION_ERROR",
            f"name: {body.name!r} in the body, but {name!r} in the path",
            stage="request",
            hint="Leave the name out of the body.",
        )
    validated(NamedScene, {"obstacles": [], "name": name})
    content = await _made(request, name)
    before = await _prepared_as(request, name)
    record = await run_in_threadpool(_store(request).replace, _KIND, name, content)
    if before is not None and before.hash != record.hash:
        await run_in_threadpool(disk_cache.forget, before)
    if record.version == 1:
        response.status_code = 201
        response.headers["Location"] = f"/v1/scenes/{name}"
    return _summary(record)


@router.delete("/{name}", status_code=204, summary="Delete a scene")
async def delete_scene(name: str, request: Request) -> None:
    """Forgets the scene."""
    before = await _prepared_as(request, name)
    await run_in_threadpool(_store(request).delete, _KIND, name)
    if before is not None:
        await run_in_threadpool(disk_cache.forget, before)


async def _made(request: Request, name: str) -> bytes:
    """The document of a scene that a worker has built of the request."""
    folder = str(request.app.state.settings.prepared_dir)
    job = Job("service.tasks.robots:make_scene", (await request.body(), folder, name))
    content: bytes = await robot_repository.build(request, job)
    return content


async def _prepared_as(request: Request, name: str) -> Reference | None:
    """Where workers keep what is stored under a name, if there is something."""
    try:
        return await robot_repository.scene(request, name)
    except ProblemError:
        return None


def _store(request: Request) -> Store:
    store: Store = request.app.state.store
    return store


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
