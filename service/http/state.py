"""State of the running application, and of requests that belong to jobs or replays, typed."""

import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from fastapi import Request
from starlette.concurrency import run_in_threadpool

from service.access.authentication import ANYONE, Caller, caller_of
from service.settings import Settings
from service.storage.caches.cache_key import Reference
from service.storage.caches.recent import Recent
from service.storage.robot_repository import RobotRepository
from service.storage.store import Store
from service.storage.stores.audit_store import Actor
from service.storage.stores.document_store import DocumentStore
from service.storage.stores.plan_store import PlanContent, PlanRecord, Retention
from service.workers.supervisor import WorkerSupervisor

#: Key in the scope of a request, with the references that it was answered for, by their kind.
USED_REFERENCES = "armwright.used_references"
#: Key in the scope of a request, with the document of the stored tool that it names, JSON.
STORED_TOOL = "armwright.stored_tool"
#: Key in the scope of a replayed request, with its `Replay`.
REPLAY = "armwright.replay"


@dataclass(frozen=True, slots=True)
class Replay:
    """The replay that a request is part of.

    Args:
        plan_id: The kept plan.
        pinned: Robot and scene as they were kept; a name that is not among them is looked up.
    """

    plan_id: str
    pinned: tuple[Reference, ...] = ()


def new_id() -> str:
    """The id of a new job or kept plan: later ones sort after earlier ones; none can be guessed."""
    return f"{int(1000 * time.time()):012x}{secrets.token_hex(10)}"


def note_reference(request: Request, reference: Reference) -> None:
    """Note which robot or scene a request is answered for."""
    request.scope.setdefault(USED_REFERENCES, {})[reference.kind] = reference


def retention(settings: Settings) -> Retention:
    """Bounds of the kept plans."""
    return Retention(settings.plan_lifetime, settings.plan_count, settings.plan_storage)


def settings_of(request: Request) -> Settings:
    """The settings of the service."""
    settings: Settings = request.app.state.settings
    return settings


def store_of(request: Request) -> Store:
    """The storage of documents and answers."""
    store: Store = request.app.state.store
    return store


def documents_of(request: Request) -> DocumentStore:
    """The robots and scenes of the caller's tenant, as documents."""
    caller = caller_of(request.scope)
    actor = Actor(caller.tenant, caller.api_key)
    store = store_of(request)
    return DocumentStore(store.database, actor, caller.storage_limit)


def repository_of(request: Request) -> RobotRepository:
    """Robots and scenes by name."""
    replay: Replay | None = request.scope.get(REPLAY)
    pinned = () if replay is None else replay.pinned
    tenant = caller_of(request.scope).tenant
    kept = partial(store_of(request).plans.document, tenant=tenant)
    return RobotRepository(documents_of(request), prepared_folder(request), pinned, kept)


async def kept_plan(request: Request, plan_id: str) -> tuple[PlanRecord, PlanContent]:
    """A kept plan of the caller's tenant.

    Raises:
        ProblemError: NOT_FOUND.
    """
    tenant = caller_of(request.scope).tenant
    return await run_in_threadpool(store_of(request).plans.get, plan_id, tenant)


def models_of(request: Request) -> Recent:
    """Models of robots that were asked for lately, by hash and whether the robot is built in."""
    models: Recent = request.app.state.models
    return models


def supervisor_of(request: Request) -> WorkerSupervisor:
    """The supervisor of the workers."""
    supervisor: WorkerSupervisor = request.app.state.supervisor
    return supervisor


def prepared_folder(request: Request) -> str:
    """Folder of prepared robots and scenes."""
    return settings_of(request).prepared_dir


#: Key in the scope of a request that is only checked: would it be accepted as a job?
DRY_RUN = "armwright.dry_run"
#: Key in the scope of a job's request, with its `JobContext`.
JOB_CONTEXT = "armwright.job"


class DeferToJob(Exception):
    """A request that is only checked came as far as its work, so it may become a job."""


@dataclass(frozen=True, slots=True)
class JobContext:
    """The job on whose behalf a request is answered, in place of a client that waits.

    Args:
        id: The job.
        deadline: Deadline of the job, on the clock of `time.monotonic` [s].
        on_start: Called when a worker begins with it.
        on_progress: Called with the progress, from 0 to 1, and the stage that a worker reports.
        caller: Caller who owns the job.
        first: Index of its first problem in the batch that it is a chunk of.
    """

    id: str
    deadline: float
    on_start: Callable[[], None]
    on_progress: Callable[[float, str], None]
    caller: Caller = ANYONE
    first: int = 0


def job_context(request: Request) -> JobContext | None:
    """The job that a request belongs to; None where a client waits."""
    context: JobContext | None = request.scope.get(JOB_CONTEXT)
    return context


def end_dry_run(request: Request) -> None:
    """End here if the request is only checked.

    Raises:
        DeferToJob: It is.
    """
    if request.scope.get(DRY_RUN):
        raise DeferToJob
