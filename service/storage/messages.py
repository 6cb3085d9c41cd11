"""Messages of procrastinate that tell agents of jobs: added in the transactions of our rows."""

from collections.abc import Sequence

from sqlalchemy import Connection, text

from service.storage.database import Database

#: The queue of jobs for agents, and the task that the engine calls with the id of a job.
QUEUE = "armwright"
TASK = "carry"
#: Jobs go before chunks of batches, so that a large batch doesn't keep the others waiting.
JOB_PRIORITY = 1
CHUNK_PRIORITY = 0
#: Key of the lock under which one server makes the tables of the engine.
_INSTALLATION_LOCK = 0x41524D51

_ADD = text(
    "SELECT procrastinate_defer_jobs_v1(ARRAY("
    "SELECT ROW(CAST(:queue AS varchar), CAST(:task AS varchar), CAST(:priority AS integer),"
    " NULL, NULL,"
    " jsonb_build_object('job', id), NULL)::procrastinate_job_to_defer_v1"
    " FROM unnest(CAST(:ids AS text[])) WITH ORDINALITY AS listed (id, number) ORDER BY number))"
).bindparams(queue=QUEUE, task=TASK)
_WAITING = text(
    "SELECT count(*) FROM procrastinate_jobs WHERE queue_name = :queue AND status = 'todo'"
).bindparams(queue=QUEUE)
_IS_INSTALLED = text("SELECT to_regclass('procrastinate_jobs') IS NOT NULL")


def install(database: Database, schema: str) -> None:
    """Make the tables of the engine, unless they are there.

    Args:
        database: Database of PostgreSQL.
        schema: The statements of the engine, SQL.

    Raises:
        StorageUnavailable: The database can't be used now.
    """
    with database.transaction() as connection:
        connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({_INSTALLATION_LOCK})")
        if not connection.execute(_IS_INSTALLED).scalar_one():
            # Many statements at once, for which the driver wants no parameters, not even none.
            connection.connection.cursor().execute(schema)


def add_messages(connection: Connection, ids: Sequence[str], priority: int) -> None:
    """Tell agents of jobs, once the transaction of a connection is committed.

    Args:
        connection: Connection in a transaction.
        ids: The jobs, the first one first.
        priority: Messages of a higher one go first.
    """
    connection.execute(_ADD, {"ids": list(ids), "priority": priority})


def waiting_messages(database: Database) -> int:
    """The number of jobs and chunks that wait for an agent.

    Raises:
        StorageUnavailable: The database can't be used now.
    """
    with database.reading() as connection:
        return int(connection.execute(_WAITING).scalar_one())
