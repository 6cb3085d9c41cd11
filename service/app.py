"""The application: `create_app`."""

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

from fastapi import FastAPI
from starlette.concurrency import run_in_threadpool

from armwright_wire.base import build_at_once
from service.access.authentication import Authenticator
from service.endpoints import routes, scenes, tools
from service.endpoints.batch import route as batch
from service.endpoints.dynamics import route as dynamics
from service.endpoints.guard import route as guard
from service.endpoints.health import route as health
from service.endpoints.jobs import route as jobs
from service.endpoints.pages import route as pages
from service.endpoints.plan import route as plan
from service.endpoints.plans import route as plans
from service.endpoints.robots import route as robots
from service.housekeeping import keep_house, watch_storage
from service.http import errors, openapi
from service.http.audit import AuditAccount
from service.http.json_route import JsonRoute
from service.http.layer.admission import Admission
from service.http.layer.middleware import ServiceMiddleware
from service.http.metrics import Metrics
from service.jobs.answer import defer
from service.jobs.runner import AgentJobs, Jobs
from service.settings import Settings
from service.storage.caches.recent import Recent
from service.storage.store import Store, open_store
from service.task_references import RECIPE
from service.tracing.extra import install_tracing, open_tracing
from service.version import VERSION
from service.workers.fork.launch import Launched
from service.workers.process import WorkerLimits
from service.workers.supervisor import WorkerSupervisor

if TYPE_CHECKING:
    from service.tracing.tracer import Tracing

#: Worker processes beyond those that were asked for: a worker that dies is replaced at once, and
#: what takes a millisecond is answered while all others plan. It shares nearly all its memory.
_SPARES = 1
#: Models of robots that the server keeps; one is some kilobytes.
_MODELS = 256
#: And how much they may be together [byte].
_MODEL_BYTES = 16 * 2**20
#: In the order in which a request is compared with their routes, which costs microseconds each:
#: those that compute come first.
_ROUTERS = (
    plan.router,
    guard.router,
    *routes.ROUTERS,
    pages.router,
    health.router,
    pages.problem_router,
    robots.router,
    scenes.router,
    tools.router,
    plans.router,
    dynamics.router,
    batch.router,
    jobs.router,
)

build_at_once()


def create_app(
    settings: Settings | None = None,
    launched: Launched | None = None,
    *,
    is_agent: bool = False,
    tracing: "Tracing | None" = None,
) -> FastAPI:
    """The service as an ASGI application.

    Storage and workers are opened when it starts and closed when it ends; requests find them as
    ``request.app.state.store`` and ``request.app.state.supervisor``.

    Args:
        settings: Settings of the service; those of the environment if left out.
        launched: A fork server with `RECIPE` that was started already.
        is_agent: Whether the process works on the jobs that a queue carries to agents.
        tracing: Traces, in place of those that the settings ask for.

    Raises:
        TelemetryMissing: The settings ask for traces, and the extra `telemetry` is not installed.
    """
    chosen = settings or Settings()
    tracing = tracing or open_tracing(chosen.traces)
    logging.getLogger(__package__).setLevel(chosen.log_level.upper())

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        app.state.store = await run_in_threadpool(open_store, chosen.storage_url, exclusive=True)
        app.state.models = Recent(_MODELS, _MODEL_BYTES, lambda model: len(model.answer))
        app.state.authenticator = Authenticator(app.state.store.keys)
        supervisor = WorkerSupervisor(
            chosen.workers,
            chosen.queue_limit,
            kill_grace=chosen.kill_grace,
            recipe=RECIPE,
            launched=launched,
            spares=_SPARES,
            limits=WorkerLimits(
                chosen.worker_memory, chosen.worker_growth, chosen.worker_jobs, chosen.worker_age
            ),
        )
        app.state.supervisor = supervisor
        supervisor.watcher = None if tracing is None else tracing.watch
        app.state.admission = Admission(supervisor, chosen)
        app.state.jobs = _jobs(app, chosen, is_agent)
        await supervisor.start()
        chores = [
            asyncio.create_task(watch_storage(app.state.store.database)),
            asyncio.create_task(keep_house(chosen, app.state.store.plans)),
        ]
        try:
            await app.state.jobs.start()
            yield
        finally:
            for chore in chores:
                chore.cancel()
            await app.state.jobs.stop()
            await supervisor.stop()
            await run_in_threadpool(app.state.store.close)
            if tracing is not None:
                await run_in_threadpool(tracing.close)

    app = FastAPI(
        # Generators name their packages by it; armwright_client is ours.
        title="Armwright API",
        version=VERSION,
        description=openapi.DESCRIPTION,
        license_info={"name": "Apache-2.0", "identifier": "Apache-2.0"},
        lifespan=lifespan,
        redirect_slashes=False,
        docs_url=None,
        redoc_url=None,
        openapi_url=None,
        # `service.tracing` makes the spans; the framework adds none.
        telemetry={"tracing": False, "metrics": False, "logs": False, "auto_configure": False},
        generate_unique_id_function=lambda route: route.name,
    )
    app.state.settings = chosen
    app.state.stopping = False
    app.state.guarded = set()
    app.state.defer = defer
    app.state.metrics = Metrics(app)
    app.state.audit_account = AuditAccount()
    app.state.openapi = None
    app.router.route_class = JsonRoute
    app.state.swagger = pages.swagger_folder()
    app.add_middleware(
        ServiceMiddleware,
        application=app,
        settings=chosen,
        metrics=app.state.metrics,
        health_only=is_agent,
    )
    if tracing is not None:
        install_tracing(app, tracing)
    errors.install(app)
    openapi.install(app)
    for router in _ROUTERS:
        app.include_router(router)
    return app


def _jobs(app: FastAPI, settings: Settings, is_agent: bool) -> Jobs:
    """The jobs of an application whose storage and workers are open."""
    store: Store = app.state.store
    if settings.jobs == "server" and not is_agent:
        return Jobs(app, store, settings)
    is_agent = is_agent or settings.jobs == "both"
    return AgentJobs(app, store, settings, app.state.supervisor, is_agent=is_agent)
