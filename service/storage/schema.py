"""The schema of a database: which revision it has, and the way to the one of this version.

Alembic runs the migrations, and is loaded only where there are some to run.
"""

from pathlib import Path

from sqlalchemy import Connection, Engine, inspect, text

from service.storage.tables import REVISIONS

#: `user_version` of SQLite files: 1 before there were migrations, and 2 since, so that versions of
#: before refuse them.
_BEFORE_MIGRATIONS = 1
_WITH_MIGRATIONS = 2
#: Key of the lock under which servers that share a PostgreSQL database migrate it, one at a time.
_MIGRATION_LOCK = 0x41524D57
#: Longest time that a migration of a PostgreSQL database may take [ms].
_MIGRATION_TIMEOUT = 600_000


#: Execution option of connections that write: how durable their transactions are to be in SQLite.
DURABILITY = "armwright_durability"


class DamagedFile(Exception):
    """A SQLite file has lost its inner order."""


class NewerSchema(Exception):
    """A newer version wrote the database."""

    def __init__(self, revision: str) -> None:
        super().__init__(
            f"was written by a newer version of Armwright (schema {revision}, this one knows those "
            f"up to {REVISIONS[-1]}); use that version or another database"
        )


def migrate(engine: Engine) -> None:
    """Bring a database to the schema of this version, in one transaction.

    Raises:
        DamagedFile: The file is damaged.
        NewerSchema: A newer version wrote the database.
        sqlalchemy.exc.SQLAlchemyError: The database can't be used.
    """
    if engine.dialect.name == "sqlite":
        with engine.connect() as connection:
            _check_file(connection)
            connection.exec_driver_sql("PRAGMA journal_mode = WAL")
    with engine.connect() as connection:
        if _revision(connection) == REVISIONS[-1]:
            return
    writing = engine.execution_options(**{DURABILITY: "FULL"})
    with writing.begin() as connection:
        if engine.dialect.name == "postgresql":
            connection.exec_driver_sql(f"SET LOCAL statement_timeout = {_MIGRATION_TIMEOUT}")
            connection.exec_driver_sql(f"SET LOCAL lock_timeout = {_MIGRATION_TIMEOUT}")
            connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({_MIGRATION_LOCK})")
        if _revision(connection) != REVISIONS[-1]:
            _upgrade(connection)
        if engine.dialect.name == "sqlite":
            connection.exec_driver_sql(f"PRAGMA user_version = {_WITH_MIGRATIONS}")


def _check_file(connection: Connection) -> None:
    verdict = connection.exec_driver_sql("PRAGMA quick_check(1)").scalar_one()
    if verdict != "ok":
        raise DamagedFile(verdict)
    version = connection.exec_driver_sql("PRAGMA user_version").scalar_one()
    if version not in (0, _BEFORE_MIGRATIONS, _WITH_MIGRATIONS):
        raise NewerSchema(str(version))


def _revision(connection: Connection) -> str | None:
    """The revision that a database has; None before its first migration."""
    if not inspect(connection).has_table("alembic_version"):
        return None
    revision = connection.execute(text("SELECT version_num FROM alembic_version")).scalar()
    if revision is not None and revision not in REVISIONS:
        raise NewerSchema(revision)
    return revision


def _upgrade(connection: Connection) -> None:
    from alembic import command  # noqa: PLC0415  (0.1 s that a usual start does not need)
    from alembic.config import Config  # noqa: PLC0415

    config = Config()
    config.set_main_option("script_location", str(Path(__file__).with_name("migrations")))
    config.attributes["connection"] = connection
    command.upgrade(config, REVISIONS[-1])
