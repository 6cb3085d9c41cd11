"""The server's view of robots and scenes: who they are, and that workers find them prepared."""

from collections.abc import Awaitable, Callable
from typing import Any

from fastapi import Request
from starlette.concurrency import run_in_threadpool

from kinematics.chain import Chain
from kinematics.robots import builtin_names
from service.http.compute import compute
from service.http.errors import ProblemError, from_fields
from service.schemas.scene import Scene
from service.settings import Settings
from service.storage import worker_cache
from service.storage.cache_key import NotPrepared, Reference, builtin_reference
from service.storage.disk_cache import PreparedRobot
from service.storage.document_store import Store
from service.tasks.result import CacheMiss, TaskProblem
from service.workers.main import Job
from service.workers.process import Progress

#: Cutting the meshes of a whole robot takes some seconds, of a bad one a minute [s].
BUILD_TIMEOUT = 120.0
#: Preparing what a task found missing, and once more if it was replaced meanwhile.
_ATTEMPTS = 3


def is_built_in(name: str) -> bool:
    """Whether a robot of this name comes with the app."""
    return name in builtin_names()


async def robot(request: Request, name: str) -> Reference:
    """The robot of a name.

    Raises:
        ProblemError: NOT_FOUND.
    """
    folder = _folder(request)
    if is_built_in(name):
        return builtin_reference(name, folder)
    try:
        record = await run_in_threadpool(_store(request).record, "robot", name)
    except ProblemError as error:
        error.hint = (
            f"GET /v1/robots lists those there are; built in: {', '.join(builtin_names())}."
        )
        raise
    return Reference("robot", name, record.hash, folder)


async def scene(request: Request, source: str | Scene | None) -> Reference | None:
    """The stored scene that a request names, or None where it names none.

    Raises:
        ProblemError: NOT_FOUND.
    """
    if not isinstance(source, str):
        return None
    record = await run_in_threadpool(_store(request).record, "scene", source)
    return Reference("scene", source, record.hash, _folder(request))


async def chain(request: Request, name: str) -> Chain:
    """The chain of a robot, kept in this process.

    Raises:
        ProblemError: NOT_FOUND.
    """
    return (await model(request, await robot(request, name))).chain


async def model(request: Request, reference: Reference) -> PreparedRobot:
    """A robot as it was prepared, kept in this process.

    Raises:
        ProblemError: NOT_FOUND, it was deleted meanwhile.
    """
    if worker_cache.loaded(reference):
        return worker_cache.robot(reference)
    for _ in range(_ATTEMPTS):
        try:
            return await run_in_threadpool(_with_chain, reference)
        except NotPrepared:
            reference = await _prepare(request, reference)
    raise _unprepared()


async def answer(
    request: Request,
    make_job: Callable[[Reference, Reference | None], Job],
    robot_name: str,
    scene_source: str | Scene | None = None,
    *,
    timeout: float | None = None,
    patience: float = 0.0,
    on_progress: Progress | None = None,
) -> Any:
    """The result of a job about a robot and perhaps a scene, computed in a worker.

    Args:
        request: On whose behalf.
        make_job: Makes the job from the references of the robot and of a stored scene.
        robot_name: The robot.
        scene_source: The scene as the request gives it.
        timeout: As the request names it [s].
        patience: How much later the worker is ended [s].
        on_progress: Told of progress in place of the job that the request belongs to.

    Raises:
        ProblemError: NOT_FOUND; what the task refused; all of `compute`.
    """

    async def job() -> Job:
        return make_job(await robot(request, robot_name), await scene(request, scene_source))

    return await _answer(request, job, timeout, patience, on_progress)


async def answer_with(
    request: Request,
    make_job: Callable[[Reference | None], Job],
    robot_name: str | None,
    *,
    timeout: float | None = None,
) -> Any:
    """The result of a job that may be about a robot, computed in a worker.

    Raises:
        ProblemError: As `answer`.
    """

    async def job() -> Job:
        return make_job(None if robot_name is None else await robot(request, robot_name))

    return await _answer(request, job, timeout, 0.0)


async def answer_scene(
    request: Request, make_job: Callable[[Reference], Job], scene_name: str
) -> Any:
    """The result of a job about a stored scene, computed in a worker.

    Raises:
        ProblemError: As `answer`.
    """

    async def job() -> Job:
        reference = await scene(request, scene_name)
        assert reference is not None
        return make_job(reference)

    return await _answer(request, job, None, 0.0)


async def _answer(
    request: Request,
    make_job: Callable[[], Awaitable[Job]],
    timeout: float | None,
    patience: float,
    on_progress: Progress | None = None,
) -> Any:
    for _ in range(_ATTEMPTS):
        job = await make_job()
        result = await compute(request, job, timeout, patience, on_progress)
        if isinstance(result, CacheMiss):
            await _prepare(request, result.reference)
            continue
        if isinstance(result, TaskProblem):
            raise from_fields(result.code, result.message, result.hint, result.details)
        return result
    raise _unprepared()


def _with_chain(reference: Reference) -> PreparedRobot:
    found = worker_cache.robot(reference)
    _ = found.chain  # made here, in a thread, and kept
    return found


async def build(request: Request, job: Job) -> Any:
    """The result of a job that builds something, which may take longer than others."""
    settings: Settings = request.app.state.settings
    return await compute(request, job, min(BUILD_TIMEOUT, settings.max_timeout))


async def _prepare(request: Request, reference: Reference) -> Reference:
    """Have a worker build what is stored once more: the data folder lost it, or is newer."""
    document = await run_in_threadpool(_store(request).get, reference.kind, reference.name)
    if reference.kind == "robot":
        job = Job("service.tasks.robots:prepare_robot", (document.content, reference.folder))
    else:
        arguments = (document.content, reference.folder, reference.name)
        job = Job("service.tasks.robots:prepare_scene", arguments)
    await build(request, job)
    return Reference(reference.kind, reference.name, document.record.hash, reference.folder)


def _unprepared() -> ProblemError:
    return ProblemError(
        "CONFLICT",
        "the robot or the scene keeps being replaced",
        stage="storage",
        hint="Ask again when nobody changes it.",
    )


def _folder(request: Request) -> str:
    settings: Settings = request.app.state.settings
    return str(settings.prepared_dir)


def _store(request: Request) -> Store:
    store: Store = request.app.state.store
    return store
