"""The queue of procrastinate, which brings jobs to agents: the only module that knows it.

A message names a job. It is put back for as long as there is work on its job left, whatever has
happened to the agent that had it; which answer counts is decided by the row of the job.
"""

import asyncio
import contextlib
import importlib.util
import logging
from collections.abc import Awaitable, Callable, Iterable
from typing import TYPE_CHECKING

from service.storage.database import StoreError
from service.storage.messages import QUEUE, TASK
from service.storage.stores.server_store import HEARTBEAT, LIFETIME

if TYPE_CHECKING:
    from procrastinate import App
    from procrastinate.jobs import Job
    from procrastinate.worker import Worker

_log = logging.getLogger(__name__)
#: After this time an agent tries again to reach a queue that it could not reach [s].
_RECONNECTION = 1.0
#: After this time a message comes again whose job could not be worked on [s].
_RETRY = 1.0
#: How often messages are looked for that nobody announced: those put back for later [s].
_POLLING = 1.0
#: Longest wait for a connection [s], and for the acknowledgement of what was sent [ms].
_CONNECTION_TIMEOUT = 5.0
_ACKNOWLEDGE_TIMEOUT = 10_000
#: Connections of an agent to the queue: it fetches, ends and listens.
_CONNECTIONS = 3


class TryLater(Exception):
    """A message must come again: another agent has its job, or this one gives the job back.

    Args:
        delay: Time until then [s].
    """

    def __init__(self, delay: float = _RETRY) -> None:
        super().__init__(f"again in {delay:g} s")
        self.delay = delay


def require_engine(url: str) -> None:
    """Check that jobs can be given to agents.

    Raises:
        StoreError: The database is not PostgreSQL, or the engine is not installed.
    """
    if not url.startswith("postgresql"):
        raise StoreError(
            "agents need a PostgreSQL database, which all machines share: set "
            "ARMWRIGHT_DATABASE_URL to postgresql+psycopg://<user>:<password>@<host>/<database>"
        )
    if importlib.util.find_spec("procrastinate") is None:
        raise StoreError("agents need the extra `agents`: pip install 'armwright[agents]'")


def engine_schema() -> str:
    """The statements that make the tables of the engine, SQL."""
    from procrastinate.schema import SchemaManager  # noqa: PLC0415

    return SchemaManager.get_schema()


class Engine:
    """Messages of the queue, each handed to a function that works on its job.

    Args:
        url: Url of the PostgreSQL database.
        concurrency: Messages that are worked on at a time.
        carry: Works on the job of an id. It returns once there is nothing left to do for it, and
            raises otherwise.
    """

    def __init__(self, url: str, concurrency: int, carry: Callable[[str], Awaitable[None]]) -> None:
        self._url = url.replace("postgresql+psycopg://", "postgresql://", 1)
        self._concurrency = concurrency
        self._carry = carry
        self._stopping = False
        self._in_hand: set[int | None] = set()
        self._worker: Worker | None = None
        #: Whether the queue was reached and is being listened to.
        self.is_connected = False

    async def run(self) -> None:
        """Take messages until `stop`, and connect again whenever the connection is lost."""
        while not self._stopping:
            try:
                await self._work()
            except Exception as error:  # noqa: BLE001  (whatever it is, messages must be taken)
                _log.warning("the queue of jobs can't be reached: %s", error)
            self.is_connected = False
            if not self._stopping:
                await asyncio.sleep(_RECONNECTION)

    def stop(self) -> None:
        """Take no more messages; `run` ends when those that were taken are done."""
        self._stopping = True
        if self._worker is not None:
            self._worker.shutdown_graceful_timeout = None
            self._worker.stop()  # type: ignore[no-untyped-call]

    async def _work(self) -> None:
        from procrastinate.jobs import DeleteJobCondition  # noqa: PLC0415
        from procrastinate.worker import Worker  # noqa: PLC0415

        app = self._application()
        async with app.open_async():
            self._worker = Worker(
                app,
                queues=[QUEUE],
                concurrency=self._concurrency,
                fetch_job_polling_interval=_POLLING,
                # After a lost connection messages go back at once; their jobs go on.
                shutdown_graceful_timeout=0.0,
                delete_jobs=DeleteJobCondition.ALWAYS,
                install_signal_handlers=False,
                update_heartbeat_interval=HEARTBEAT,
                stalled_worker_timeout=LIFETIME,
            )
            reviving = asyncio.create_task(self._revive_periodically(app, self._worker))
            self.is_connected = True
            try:
                if not self._stopping:
                    await self._worker.run()  # type: ignore[no-untyped-call]
            finally:
                reviving.cancel()
                self._worker = None

    def _application(self) -> "App":
        from procrastinate import App, PsycopgConnector  # noqa: PLC0415
        from procrastinate.job_context import JobContext  # noqa: PLC0415
        from procrastinate.jobs import Job  # noqa: PLC0415
        from procrastinate.retry import BaseRetryStrategy, RetryDecision  # noqa: PLC0415

        class Again(BaseRetryStrategy):
            """Has every message come again that was not done."""

            def get_retry_decision(
                self,
                *,
                exception: BaseException,
                job: Job,  # noqa: ARG002
            ) -> RetryDecision:
                delay = 0.0 if isinstance(exception, asyncio.CancelledError) else _RETRY
                if isinstance(exception, TryLater):
                    delay = exception.delay
                return RetryDecision(retry_in={"milliseconds": int(1000.0 * delay)})

        for name in ("procrastinate", "psycopg.pool"):  # `run` says what concerns people
            logging.getLogger(name).setLevel(logging.CRITICAL)
        connector = PsycopgConnector(
            conninfo=self._url,
            min_size=1,
            max_size=_CONNECTIONS,
            timeout=_CONNECTION_TIMEOUT,
            kwargs={
                "connect_timeout": int(_CONNECTION_TIMEOUT),
                "tcp_user_timeout": _ACKNOWLEDGE_TIMEOUT,
            },
        )
        app = App(connector=connector)

        async def carry(context: JobContext, job: str) -> None:
            self._in_hand.add(context.job.id)
            try:
                await self._carry(job)
            finally:
                self._in_hand.discard(context.job.id)

        app.task(name=TASK, queue=QUEUE, retry=Again(), pass_context=True)(carry)
        return app

    async def _revive_periodically(self, app: "App", worker: "Worker") -> None:
        """Put back messages that nobody works on, for ever.

        They are those of agents that have fallen silent, and those of this one whose arrival or
        end was lost with a connection.
        """
        astray: set[int | None] = set()
        while True:
            await asyncio.sleep(HEARTBEAT)
            # What fails is tried again; that the queue can't be reached is noticed elsewhere.
            with contextlib.suppress(Exception):
                silent = await app.job_manager.get_stalled_jobs(
                    queue=QUEUE, seconds_since_heartbeat=LIFETIME
                )
                own: Iterable[Job] = ()
                if worker.worker_id is not None:
                    own = await app.job_manager.list_jobs_async(
                        queue=QUEUE, status="doing", worker_id=worker.worker_id
                    )
                idle = [message for message in own if message.id not in self._in_hand]
                # Others are about to begin or to end.
                lost = [message for message in idle if message.id in astray]
                astray = {message.id for message in idle}
                for message in (*silent, *lost):
                    with contextlib.suppress(Exception):  # another agent did it
                        await app.job_manager.retry_job(message)
