"""Answers that workers compute for robots and scenes, which are prepared first where needed."""

from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar, cast

from fastapi import Request, Response
from pydantic import BaseModel
from starlette.concurrency import run_in_threadpool

from armwright_wire.scenes.scene import Scene
from armwright_wire.scenes.tool import WithTool
from service.http.compute import compute, compute_at_once
from service.http.state import (
    STORED_TOOL,
    documents_of,
    models_of,
    note_reference,
    prepared_folder,
    repository_of,
    settings_of,
)
from service.storage.caches.cache_key import Kind, Mount, Reference, builtin_reference
from service.storage.caches.mounts import MOUNTING, Asked, mount_of, named_tools, robot_tools
from service.storage.robot_repository import is_built_in
from service.task_references import prepare_robot, prepare_scene, robot_model
from service.validation import storage_problem
from service.workers.process import OnProgress
from service.workers.result import CacheMiss, RobotModel, TaskProblem
from service.workers.task import Job

_R = TypeVar("_R")

#: Cutting the meshes of a whole robot takes some seconds, of a bad one a minute [s].
BUILD_TIMEOUT = 120.0
#: Preparing what a task found missing, and once more if it was replaced meanwhile.
_ATTEMPTS = 3


async def _look_up(request: Request, *names: tuple[Kind, str | None]) -> list[Reference | None]:
    """Robots and stored scenes of a request, in one turn of a thread at most; None without a name.

    Raises:
        ProblemError: NOT_FOUND.
    """
    named = [(kind, name) for kind, name in names if name is not None]
    if not all(kind == "robot" and is_built_in(name) for kind, name in named):
        found = await run_in_threadpool(repository_of(request).look_up, names)
    else:
        folder = prepared_folder(request)
        found = [None if name is None else builtin_reference(name, folder) for _, name in names]
    for reference in found:
        if reference is not None:
            note_reference(request, reference)
    return found


async def tool_mount(request: Request, robot_name: str, asked: Asked | None = None) -> Mount | None:
    """The tool and tip that a request has its robot work with; None for the robot's own.

    Args:
        request: Request on whose behalf.
        robot_name: The robot, whose own tools come before those that are stored alone.
        asked: What says so; the body of the request if left out.

    Raises:
        ProblemError: NOT_FOUND, there is no such tool.
        ArmwrightError: A tip is named without its tool or object.
    """
    if asked is None:
        asked = await request.json() if await request.body() else {}
    if not isinstance(asked, Mapping | WithTool):
        return None
    if isinstance(asked, Mapping) and MOUNTING.isdisjoint(asked):
        return None
    if not any(isinstance(one, str) for one in named_tools(asked)):
        return mount_of(asked, _no_document)
    documents = documents_of(request)

    def stored(name: str) -> bytes:
        own: Mapping[str, bytes] = {}
        if not is_built_in(robot_name):
            own = robot_tools(documents.get("robot", robot_name).content)
        content = own.get(name) or documents.get("tool", name).content
        request.scope.setdefault(STORED_TOOL, {})[name] = content
        return content

    return await run_in_threadpool(mount_of, asked, stored)


def _no_document(name: str) -> bytes:
    raise AssertionError(name)


async def robot(request: Request, name: str) -> Reference:
    """The robot of a name.

    Raises:
        ProblemError: NOT_FOUND.
    """
    return cast(Reference, (await _look_up(request, ("robot", name)))[0])


async def scene(request: Request, name: str) -> Reference:
    """The stored scene of a name.

    Raises:
        ProblemError: NOT_FOUND.
    """
    return cast(Reference, (await _look_up(request, ("scene", name)))[0])


async def model(request: Request, name: str) -> RobotModel:
    """The model of a robot, kept in this process.

    Raises:
        ProblemError: NOT_FOUND.
    """
    models = models_of(request)
    reference = await robot(request, name)
    key = reference.hash, reference.built_in
    if key not in models:
        described = await answer(
            request, lambda robot, _: robot_model.job(robot), name, asked={}, at_once=True
        )
        # It may have been replaced meanwhile: kept under its key only if it was not.
        if await robot(request, name) != reference:
            return described
        models.put(key, described)
    kept: RobotModel = models.get(key, lambda: described)
    return kept


async def references(
    request: Request,
    robot_name: str | None,
    scene_source: str | Scene | None,
    asked: Asked | None = None,
) -> tuple[Reference | None, Reference | None]:
    """References of a robot, with the tool that it works with, and of a stored scene.

    Args:
        request: Request on whose behalf.
        robot_name: The robot, if there is one.
        scene_source: The scene as the request gives it.
        asked: What says which tool is mounted; the body of the request if left out.

    Raises:
        ProblemError: NOT_FOUND.
    """
    scene_name = scene_source if isinstance(scene_source, str) else None
    mount = None if robot_name is None else await tool_mount(request, robot_name, asked)
    found, around = await _look_up(request, ("robot", robot_name), ("scene", scene_name))
    return found if found is None or mount is None else replace(found, mount=mount), around


async def answer(
    request: Request,
    make_job: Callable[[Reference, Reference | None], Job[_R | TaskProblem | CacheMiss]],
    robot_name: str | None,
    scene_source: str | Scene | None = None,
    *,
    timeout: float | None = None,
    on_progress: OnProgress | None = None,
    asked: Asked | None = None,
    at_once: bool = False,
) -> _R:
    """The result of a job about a robot and perhaps a scene, computed in a worker.

    Args:
        request: Request on whose behalf.
        make_job: Makes the job from the references of the robot and of a stored scene.
        robot_name: The robot; None for a job that needs none, or only a scene.
        scene_source: The scene as the request gives it.
        timeout: Timeout as the request names it [s].
        on_progress: Told of progress in place of the job that the request belongs to.
        asked: What says which tool is mounted; the body of the request if left out.
        at_once: Whether the job takes a millisecond: it is done whatever else is being computed.

    Raises:
        ProblemError: NOT_FOUND; what the task refused; all of `compute` or `compute_at_once`.
    """

    async def run() -> _R | TaskProblem | CacheMiss:
        found, around = await references(request, robot_name, scene_source, asked)
        job = make_job(cast(Reference, found), around)
        if at_once:
            return await compute_at_once(request, job)
        return await compute(request, job, timeout, on_progress)

    return await prepared_result(request, run)


async def prepared_result(
    request: Request, run: Callable[[], Awaitable[_R | TaskProblem | CacheMiss]]
) -> _R:
    """The result of a job, run again once the robot or scene that it found missing is prepared.

    Args:
        request: Request on whose behalf.
        run: Computes the job.

    Raises:
        ProblemError: What the task refused; CONFLICT, what is stored keeps being replaced.
    """
    for _ in range(_ATTEMPTS):
        result = await run()
        if isinstance(result, TaskProblem):
            raise result.error
        if not isinstance(result, CacheMiss):
            return result
        await _prepare(request, result.reference)
    raise storage_problem(
        "CONFLICT",
        "the robot or the scene keeps being replaced",
        hint="Ask again when nobody changes it.",
    )


async def respond(
    request: Request,
    make_job: Callable[[Reference, Reference | None, bytes], Job[bytes | TaskProblem | CacheMiss]],
    robot_name: str | None,
    body: BaseModel,
    media_type: str = "application/json",
    *,
    at_once: bool = False,
) -> Response:
    """Response with the result of a job about the body of a request, a robot and perhaps a scene.

    Args:
        request: Request on whose behalf.
        make_job: Makes the job from the references and the content of the body.
        robot_name: The robot, if there is one.
        body: The body.
        media_type: Media type of the result.
        at_once: At once as `answer` has it.

    Raises:
        ProblemError: As `answer`.
    """
    content = await request.body()
    result = await answer(
        request,
        lambda robot, scene: make_job(robot, scene, content),
        robot_name,
        getattr(body, "scene", None),
        timeout=getattr(body, "timeout", None),
        at_once=at_once,
    )
    return Response(result, media_type=media_type)


def of_robot(
    make_job: Callable[[Reference, bytes], Job[_R]],
) -> Callable[[Reference, Reference | None, bytes], Job[_R]]:
    """Maker of a job that is about a robot alone, for `respond`."""
    return lambda robot, _, content: make_job(robot, content)


def count(joints: Sequence[float] | Sequence[Sequence[float]]) -> int:
    """The number of configurations in a field ``joints``."""
    return len(joints) if isinstance(joints[0], list) else 1


def json_answer(content: bytes) -> Response:
    """An answer that is JSON already."""
    return Response(content, media_type="application/json")


async def robot_document(request: Request, name: str) -> bytes | None:
    """The stored document of a robot; None for a built-in one, which has none.

    Raises:
        ProblemError: NOT_FOUND.
    """
    if is_built_in(name):
        return None
    repository = repository_of(request)
    reference = await robot(request, name)
    return (await run_in_threadpool(repository.document, reference))[1]


async def build(request: Request, job: Job[_R]) -> _R:
    """The result of a job that builds something, which may take longer than others."""
    return await compute(request, job, min(BUILD_TIMEOUT, settings_of(request).max_timeout))


async def _prepare(request: Request, reference: Reference) -> None:
    """Have a worker build what is stored once more: the data folder lost it, or is newer."""
    current, document = await run_in_threadpool(repository_of(request).document, reference)
    if reference.kind == "robot":
        await build(request, prepare_robot.job(document, current.folder))
    else:
        await build(request, prepare_scene.job(document, current.folder, current.name))
