"""Answers that workers compute for robots and scenes, which are prepared first where needed.

Answers to requests for plans are counted, too.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol, TypeVar

from fastapi import Request, Response
from starlette.concurrency import run_in_threadpool

from armwright_wire.scenes.scene import Scene
from armwright_wire.scenes.tool import WithTool
from service.http.compute import compute, compute_at_once
from service.http.metrics import Metrics
from service.http.state import (
    STORED_TOOL,
    documents_of,
    models_of,
    note_reference,
    repository_of,
    settings_of,
)
from service.problem import ProblemError, from_fields, storage_problem
from service.storage.caches.cache_key import Kind, Mount, Reference
from service.storage.caches.mounts import Asked, mount_of, named_tools
from service.storage.robot_repository import is_built_in
from service.task_references import plan, prepare_robot, prepare_scene, robot_model
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
    repository = repository_of(request)
    found = [None if name is None else repository.recall(kind, name) for kind, name in names]
    if found.count(None) > [name for _, name in names].count(None):
        found = await run_in_threadpool(repository.look_up, names)
    for reference in found:
        if reference is not None:
            note_reference(request, reference)
    return found


async def tool_mount(request: Request, asked: Asked | None = None) -> Mount | None:
    """The tool and tip that a request has its robot work with; None for the robot's own.

    Args:
        request: Request on whose behalf.
        asked: What says so; the body of the request if left out.

    Raises:
        ProblemError: NOT_FOUND, there is no such tool.
        ArmwrightError: A tip is named without its tool or object.
    """
    if asked is None:
        asked = await request.json() if await request.body() else {}
    if not isinstance(asked, Mapping | WithTool):
        return None
    if not any(isinstance(one, str) for one in named_tools(asked)):
        return mount_of(asked, _no_document)
    documents = documents_of(request)

    def stored(name: str) -> bytes:
        content = documents.get("tool", name).content
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
    (reference,) = await _look_up(request, ("robot", name))
    assert reference is not None
    return reference


async def scene(request: Request, name: str) -> Reference:
    """The stored scene of a name.

    Raises:
        ProblemError: NOT_FOUND.
    """
    (reference,) = await _look_up(request, ("scene", name))
    assert reference is not None
    return reference


async def model(request: Request, name: str) -> RobotModel:
    """The model of a robot, kept in this process.

    Raises:
        ProblemError: NOT_FOUND.
    """
    models = models_of(request)
    reference = await robot(request, name)
    key = reference.hash, reference.built_in
    if key not in models:
        described = await answer_at_once(request, robot_model.job, name, {})
        # It may have been replaced meanwhile: kept under its key only if it was not.
        if await robot(request, name) != reference:
            return described
        models.put(key, described)
    kept: RobotModel = models.get(key, lambda: described)
    return kept


async def answer(
    request: Request,
    make_job: Callable[[Reference, Reference | None], Job[_R | TaskProblem | CacheMiss]],
    robot_name: str,
    scene_source: str | Scene | None = None,
    *,
    timeout: float | None = None,
    on_progress: OnProgress | None = None,
    asked: Asked | None = None,
) -> _R:
    """The result of a job about a robot and perhaps a scene, computed in a worker.

    Args:
        request: Request on whose behalf.
        make_job: Makes the job from the references of the robot and of a stored scene.
        robot_name: The robot.
        scene_source: The scene as the request gives it.
        timeout: Timeout as the request names it [s].
        on_progress: Told of progress in place of the job that the request belongs to.
        asked: What says which tool is mounted; the body of the request if left out.

    Raises:
        ProblemError: NOT_FOUND; what the task refused; all of `compute`.
    """
    scene_name = scene_source if isinstance(scene_source, str) else None
    names: list[tuple[Kind, str | None]] = [("robot", robot_name), ("scene", scene_name)]
    mount = await tool_mount(request, asked)
    return await _answer(request, make_job, names, timeout, on_progress, mount)


async def answer_at_once(
    request: Request,
    make_job: Callable[[Reference], Job[_R | CacheMiss]],
    robot_name: str,
    asked: Asked | None = None,
) -> _R:
    """The result of a job about a robot that takes a millisecond, whatever else is being computed.

    Args:
        request: Request on whose behalf.
        make_job: Makes the job from the reference of the robot.
        robot_name: The robot.
        asked: What says which tool is mounted; the body of the request if left out.

    Raises:
        ProblemError: NOT_FOUND; what the task refused; all of `compute_at_once`.
    """
    mount = await tool_mount(request, asked)
    for _ in range(_ATTEMPTS):
        job = make_job(replace(await robot(request, robot_name), mount=mount))
        result = await compute_at_once(request, job)
        if not isinstance(result, CacheMiss):
            return result
        await _prepare(request, result.reference)
    raise _replaced_meanwhile()


async def references(
    request: Request, robot_name: str, scene_source: str | Scene | None, asked: Asked
) -> tuple[Reference, Reference | None]:
    """References of a robot, with the tool that it works with, and of a stored scene.

    Raises:
        ProblemError: NOT_FOUND.
    """
    scene_name = scene_source if isinstance(scene_source, str) else None
    found, around = await _look_up(request, ("robot", robot_name), ("scene", scene_name))
    assert found is not None
    return replace(found, mount=await tool_mount(request, asked)), around


async def result_at_once(request: Request, job: Job[_R | TaskProblem | CacheMiss]) -> _R:
    """The result of a job that takes some milliseconds, whatever else is being computed.

    Raises:
        ProblemError: What the task refused; all of `compute_at_once`.
    """
    for _ in range(_ATTEMPTS):
        result = await compute_at_once(request, job)
        if isinstance(result, TaskProblem):
            raise from_fields(result.code, result.message, result.hint, result.details)
        if not isinstance(result, CacheMiss):
            return result
        await _prepare(request, result.reference)
    raise _replaced_meanwhile()


class RobotRequest(Protocol):
    """Fields of a request that may be about a robot, which the server itself reads."""

    @property
    def robot(self) -> str | None:
        """The name of the robot, if there is one."""

    @property
    def timeout(self) -> float | None:
        """Time for the whole request, if one is named [s]."""


async def respond_with(
    request: Request,
    make_job: Callable[[Reference | None, bytes], Job[bytes | TaskProblem | CacheMiss]],
    body: RobotRequest,
) -> Response:
    """Response with the result of a job about the body of a request, and perhaps about a robot.

    Raises:
        ProblemError: As `answer`.
    """
    content = await request.body()
    mount = None if body.robot is None else await tool_mount(request)
    names: list[tuple[Kind, str | None]] = [("robot", body.robot)]
    result = await _answer(
        request, lambda robot: make_job(robot, content), names, body.timeout, None, mount
    )
    return Response(result, media_type="application/json")


async def answer_scene(
    request: Request,
    make_job: Callable[[Reference], Job[_R | TaskProblem | CacheMiss]],
    scene_name: str,
) -> _R:
    """The result of a job about a stored scene, computed in a worker.

    Raises:
        ProblemError: As `answer`.
    """
    return await _answer(request, make_job, [("scene", scene_name)], None)


async def _answer(
    request: Request,
    make_job: Callable[..., Job[_R | TaskProblem | CacheMiss]],
    names: Sequence[tuple[Kind, str | None]],
    timeout: float | None,
    on_progress: OnProgress | None = None,
    mount: Mount | None = None,
) -> _R:
    for _ in range(_ATTEMPTS):
        found = await _look_up(request, *names)
        if mount is not None and found[0] is not None:
            found[0] = replace(found[0], mount=mount)
        job = make_job(*found)
        result = await compute(request, job, timeout, on_progress)
        if isinstance(result, CacheMiss):
            await _prepare(request, result.reference)
            continue
        if isinstance(result, TaskProblem):
            raise from_fields(result.code, result.message, result.hint, result.details)
        return result
    raise _replaced_meanwhile()


class SceneRequest(Protocol):
    """Fields of a request about a robot in a scene that the server itself reads."""

    @property
    def scene(self) -> str | Scene | None:
        """The name of a stored scene, an inline scene, or none."""

    @property
    def timeout(self) -> float | None:
        """Time for all stages together, if one is named [s]."""


class PlanProblem(SceneRequest, Protocol):
    """Fields of a request for a plan that the server itself reads."""

    @property
    def robot(self) -> str:
        """The name of the robot."""


async def respond(
    request: Request,
    make_job: Callable[[Reference, Reference | None, bytes], Job[bytes | TaskProblem | CacheMiss]],
    robot_name: str,
    body: SceneRequest,
    media_type: str = "application/json",
) -> Response:
    """Response with the result of a job about the body of a request, a robot and perhaps a scene.

    Args:
        request: Request on whose behalf.
        make_job: Makes the job from the references and the content of the body.
        robot_name: The robot.
        body: The body.
        media_type: Media type of the result.

    Raises:
        ProblemError: As `answer`.
    """
    content = await request.body()
    result = await answer(
        request,
        lambda robot, scene: make_job(robot, scene, content),
        robot_name,
        body.scene,
        timeout=body.timeout,
    )
    return Response(result, media_type=media_type)


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


async def _prepare(request: Request, reference: Reference) -> Reference:
    """Have a worker build what is stored once more: the data folder lost it, or is newer."""
    current, document = await run_in_threadpool(repository_of(request).document, reference)
    if reference.kind == "robot":
        await build(request, prepare_robot.job(document, current.folder))
    else:
        await build(request, prepare_scene.job(document, current.folder, current.name))
    return current


def _replaced_meanwhile() -> ProblemError:
    return storage_problem(
        "CONFLICT",
        "the robot or the scene keeps being replaced",
        hint="Ask again when nobody changes it.",
    )


async def plan_answer(
    request: Request,
    body: PlanProblem,
    content: bytes,
    left: bytes | None = None,
) -> bytes:
    """The answer to a request for a plan, JSON.

    Args:
        request: Request on whose behalf.
        body: The problem.
        content: The problem as JSON, for the worker.
        left: The motion that the plan leaves, JSON, where its start names one.

    Raises:
        ProblemError: There is no plan; as `answers.answer`.
    """
    metrics: Metrics = request.app.state.metrics
    try:
        outcome = await answer(
            request,
            lambda robot, scene: plan.job(robot, scene, content, left),
            body.robot,
            body.scene,
            timeout=body.timeout,
        )
    except ProblemError as problem:
        metrics.count_failure(problem.code, problem.details.get("stages"))
        raise
    metrics.count_plan(outcome.planner, outcome.stages)
    return outcome.content
