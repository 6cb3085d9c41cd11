"""Answers that workers compute for robots and scenes, which are prepared first where needed.

Answers to requests for plans are counted, too.
"""

from collections.abc import Awaitable, Callable
from functools import partial
from typing import Protocol, TypeVar

from fastapi import Request
from starlette.concurrency import run_in_threadpool

from armwright_wire.scenes.scene import Scene
from service.http.compute import compute, compute_at_once
from service.http.metrics import Metrics
from service.http.state import (
    models_of,
    note_reference,
    prepared_folder,
    repository_of,
    settings_of,
)
from service.problem import ProblemError, from_fields
from service.storage.caches.cache_key import Reference, builtin_reference
from service.storage.robot_repository import RobotRepository, is_built_in
from service.task_references import plan, prepare_robot, prepare_scene, robot_model
from service.workers.process import OnProgress
from service.workers.result import CacheMiss, RobotModel, TaskProblem
from service.workers.task import Job

_R = TypeVar("_R")

#: Cutting the meshes of a whole robot takes some seconds, of a bad one a minute [s].
BUILD_TIMEOUT = 120.0
#: Preparing what a task found missing, and once more if it was replaced meanwhile.
_ATTEMPTS = 3


async def robot(request: Request, name: str) -> Reference:
    """The robot of a name.

    Raises:
        ProblemError: NOT_FOUND.
    """
    repository = repository_of(request)
    reference = repository.recall("robot", name)
    if reference is None:
        reference = await run_in_threadpool(repository.robot, name)
    note_reference(request, reference)
    return reference


async def scene(request: Request, source: str | Scene | None) -> Reference | None:
    """The stored scene that a request names, or None where it names none.

    Raises:
        ProblemError: NOT_FOUND.
    """
    if not isinstance(source, str):
        return None
    repository = repository_of(request)
    reference = repository.recall("scene", source)
    if reference is None:
        reference = await run_in_threadpool(repository.scene, source)
    note_reference(request, reference)
    return reference


async def _robot_and_scene(
    request: Request, robot_name: str, scene_source: str | Scene | None
) -> tuple[Reference, Reference | None]:
    """The robot and the stored scene of a request, in one turn of a thread at most.

    Raises:
        ProblemError: NOT_FOUND.
    """
    known = _recall(request, robot_name, scene_source)
    if known is not None:
        return known
    scene_name = scene_source if isinstance(scene_source, str) else None
    repository = repository_of(request)
    arm, cell = await run_in_threadpool(_look_up, repository, robot_name, scene_name)
    note_reference(request, arm)
    if cell is not None:
        note_reference(request, cell)
    return arm, cell


def _recall(
    request: Request, robot_name: str, scene_source: str | Scene | None
) -> tuple[Reference, Reference | None] | None:
    """The robot and the stored scene of a request, if this process remembers both."""
    scene_name = scene_source if isinstance(scene_source, str) else None
    if scene_name is None and is_built_in(robot_name):
        built_in = builtin_reference(robot_name, prepared_folder(request))
        note_reference(request, built_in)
        return built_in, None
    repository = repository_of(request)
    arm = repository.recall("robot", robot_name)
    cell = None if scene_name is None else repository.recall("scene", scene_name)
    if arm is None or (scene_name is not None and cell is None):
        return None
    note_reference(request, arm)
    if cell is not None:
        note_reference(request, cell)
    return arm, cell


def _look_up(
    repository: RobotRepository, robot_name: str, scene_name: str | None
) -> tuple[Reference, Reference | None]:
    robot = repository.robot(robot_name)
    return robot, None if scene_name is None else repository.scene(scene_name)


async def model(request: Request, name: str) -> RobotModel:
    """The model of a robot, kept in this process.

    Raises:
        ProblemError: NOT_FOUND.
    """
    models = models_of(request)
    reference = await robot(request, name)
    key = reference.hash, reference.built_in
    if key not in models:
        described = await answer_at_once(request, robot_model.job, name)
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
) -> _R:
    """The result of a job about a robot and perhaps a scene, computed in a worker.

    Args:
        request: Request on whose behalf.
        make_job: Makes the job from the references of the robot and of a stored scene.
        robot_name: The robot.
        scene_source: The scene as the request gives it.
        timeout: Timeout as the request names it [s].
        on_progress: Told of progress in place of the job that the request belongs to.

    Raises:
        ProblemError: NOT_FOUND; what the task refused; all of `compute`.
    """
    # Not a function in here: its annotations would be evaluated for every request.
    job = partial(_job, request, make_job, robot_name, scene_source)
    return await _answer(request, job, timeout, on_progress)


async def _job(
    request: Request,
    make_job: Callable[[Reference, Reference | None], Job[_R | TaskProblem | CacheMiss]],
    robot_name: str,
    scene_source: str | Scene | None,
) -> Job[_R | TaskProblem | CacheMiss]:
    return make_job(*await _robot_and_scene(request, robot_name, scene_source))


async def answer_at_once(
    request: Request,
    make_job: Callable[[Reference], Job[_R | CacheMiss]],
    robot_name: str,
) -> _R:
    """The result of a job about a robot that takes a millisecond, whatever else is being computed.

    Raises:
        ProblemError: NOT_FOUND; what the task refused; all of `compute_at_once`.
    """
    for _ in range(_ATTEMPTS):
        job = make_job(await robot(request, robot_name))
        result = await compute_at_once(request, job)
        if not isinstance(result, CacheMiss):
            return result
        await _prepare(request, result.reference)
    raise _replaced_meanwhile()


async def answer_with(
    request: Request,
    make_job: Callable[[Reference | None], Job[_R | TaskProblem | CacheMiss]],
    robot_name: str | None,
    *,
    timeout: float | None = None,
) -> _R:
    """The result of a job that may be about a robot, computed in a worker.

    Raises:
        ProblemError: As `answer`.
    """

    async def job() -> Job[_R | TaskProblem | CacheMiss]:
        return make_job(None if robot_name is None else await robot(request, robot_name))

    return await _answer(request, job, timeout)


async def answer_scene(
    request: Request,
    make_job: Callable[[Reference], Job[_R | TaskProblem | CacheMiss]],
    scene_name: str,
) -> _R:
    """The result of a job about a stored scene, computed in a worker.

    Raises:
        ProblemError: As `answer`.
    """

    async def job() -> Job[_R | TaskProblem | CacheMiss]:
        reference = await scene(request, scene_name)
        assert reference is not None
        return make_job(reference)

    return await _answer(request, job, None)


async def _answer(
    request: Request,
    make_job: Callable[[], Awaitable[Job[_R | TaskProblem | CacheMiss]]],
    timeout: float | None,
    on_progress: OnProgress | None = None,
) -> _R:
    for _ in range(_ATTEMPTS):
        job = await make_job()
        result = await compute(request, job, timeout, on_progress)
        if isinstance(result, CacheMiss):
            await _prepare(request, result.reference)
            continue
        if isinstance(result, TaskProblem):
            raise from_fields(result.code, result.message, result.hint, result.details)
        return result
    raise _replaced_meanwhile()


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
    return ProblemError(
        "CONFLICT",
        "the robot or the scene keeps being replaced",
        stage="storage",
        hint="Ask again when nobody changes it.",
    )


class PlanProblem(Protocol):
    """The fields of a request for a plan that the server itself reads."""

    @property
    def robot(self) -> str:
        """The name of the robot."""

    @property
    def scene(self) -> str | Scene | None:
        """The name of a stored scene, an inline scene, or none."""

    @property
    def timeout(self) -> float | None:
        """For all stages together, if one is named [s]."""


async def plan_answer(
    request: Request,
    body: PlanProblem,
    content: bytes,
) -> bytes:
    """The answer to a request for a plan, JSON.

    Args:
        request: Request on whose behalf.
        body: The problem.
        content: The problem as JSON, for the worker.

    Raises:
        ProblemError: There is no plan; as `answers.answer`.
    """
    metrics: Metrics = request.app.state.metrics
    try:
        outcome = await answer(
            request,
            lambda robot, scene: plan.job(robot, scene, content),
            body.robot,
            body.scene,
            timeout=body.timeout,
        )
    except ProblemError as problem:
        metrics.count_failure(problem.code, problem.details.get("stages"))
        raise
    metrics.count_plan(outcome.planner, outcome.stages)
    return outcome.content
