"""The parts of the running application that requests use, typed."""

from fastapi import Request

from service.access.caller import caller_of
from service.settings import Settings
from service.storage.audit_store import Actor
from service.storage.document_store import DocumentStore
from service.storage.recent import Recent
from service.storage.robot_repository import RobotRepository
from service.storage.store import Store
from service.workers.supervisor import WorkerSupervisor


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
    return DocumentStore(store_of(request).database, actor, caller.storage_limit)


def repository_of(request: Request) -> RobotRepository:
    """Robots and scenes by name."""
    return RobotRepository(documents_of(request), prepared_folder(request))


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
    return str(settings_of(request).prepared_dir)
