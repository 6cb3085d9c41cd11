"""A database, SQLite or PostgreSQL: locked, migrated, checked and shared by threads."""

import fcntl
import os
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sqlalchemy import (
    Connection,
    Engine,
    Executable,
    create_engine,
    event,
    inspect,
    make_url,
    text,
)
from sqlalchemy.engine import URL
from sqlalchemy.engine.interfaces import DBAPIConnection
from sqlalchemy.exc import (
    ArgumentError,
    DataError,
    DBAPIError,
    IntegrityError,
    ProgrammingError,
    SQLAlchemyError,
)
from sqlalchemy.exc import TimeoutError as PoolTimeout
from sqlalchemy.pool import ConnectionPoolEntry, QueuePool

from compiled.kept_file import make_private
from service.storage.tables import REVISIONS, upgrade
from service.validation import ProblemError

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
        if (present := _revision(connection)) != REVISIONS[-1]:
            upgrade(connection, present)
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


class FileLocked(Exception):
    """Another process holds the lock, or this one holds it already."""


class FileLock:
    """A lock that is held until it is released or the process ends.

    Args:
        path: Path of the file, which is made if it is not there, and stays.

    Raises:
        FileLocked: The lock is held already.
        OSError: The file can't be made.
    """

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._descriptor)
            raise FileLocked(path) from None

    def release(self) -> None:
        """Let the lock go; a second time changes nothing."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


#: Connections of one process. SQLite has one writer anyway; PostgreSQL allows a hundred in all.
_CONNECTIONS = 5
#: Pages of a SQLite file that each connection keeps [KiB]; the system keeps what was read anyway.
_PAGES_KEPT = 512
#: Longest wait for a connection of the pool, and for the turn to write [s].
_TURN_TIMEOUT = 5.0
#: Longest wait for transactions when a database is closed, and the time between two looks [s].
_CLOSING_TIME = 1.0
_CLOSING_PERIOD = 0.005
#: Longest wait for a lock that another process holds [s].
_LOCK_TIMEOUT = 2.0
#: Longest wait for PostgreSQL to accept a connection [s], to answer a statement [ms], and for sent
#: data to be acknowledged [ms].
_CONNECT_TIMEOUT = 3
_STATEMENT_TIMEOUT = 10_000
_ACKNOWLEDGE_TIMEOUT = 10_000
#: Chooses LZ4, which takes a fifth of the time of PostgreSQL's own method, if the server has it
#: (from PostgreSQL 14, if it was built with it); changes nothing otherwise.
_QUICK_COMPRESSION = (
    "SELECT set_config(name, 'lz4', false) FROM pg_settings"
    " WHERE name = 'default_toast_compression' AND 'lz4' = ANY(enumvals)"
)
#: When a caller is told to ask again while the database can't be used [s].
_RETRY_AFTER = 2
#: Faults of a statement, not of the database.
_MISTAKES = (IntegrityError, ProgrammingError, DataError)
_FORMS = "sqlite:///<path> or postgresql+psycopg://<user>:<password>@<host>/<database>"


class StoreError(Exception):
    """The storage can't be opened; the message says what to do."""


class StorageUnavailable(ProblemError):
    """The database can't be used now: it is locked, full, or does not answer."""

    def __init__(self, reason: object) -> None:
        super().__init__(
            "STORAGE_UNAVAILABLE",
            f"the storage can't be used now: {reason}",
            stage="storage",
            hint="Ask again after the time in Retry-After. Whoever runs the service looks whether "
            "its disk is full or its database is down.",
            retry_after=_RETRY_AFTER,
        )


class Database:
    """A pool of connections to one database.

    A SQLite file has a write-ahead log: what was committed survives a crash of the process, and
    with ``synchronous=FULL``, which costs some milliseconds, a power failure.

    Args:
        url: ``sqlite:///<path>`` or ``postgresql+psycopg://...``.
        exclusive: Whether no other server may use the file, if it is one of SQLite.

    Raises:
        StoreError: The database can't be made, written or read, is no database of ours, is newer
            than this version, or another server uses its file.
    """

    def __init__(self, url: str, *, exclusive: bool = False) -> None:
        self._url = _parse(url)
        self.is_file = self._url.get_backend_name() == "sqlite"
        self._turn = threading.Lock()
        self._fault: str | None = None
        self._lock = self._lock_file() if self.is_file and exclusive else None
        try:
            self._engine = self._connect()
            try:
                migrate(self._engine)
            except BaseException:
                self._engine.dispose()
                raise
        except NewerSchema as error:
            self._unlock()
            raise StoreError(f"the database {self._name} {error}") from None
        except (OSError, SQLAlchemyError, DamagedFile) as error:
            self._unlock()
            raise StoreError(self._unusable(error)) from error

    @property
    def fault(self) -> str | None:
        """Why the database could not be used the last time; None if it could."""
        return self._fault

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """A connection for a statement that changes nothing.

        Raises:
            StorageUnavailable: The database can't be used now.
        """
        with self._noting_faults(), self._engine.connect() as connection:
            yield connection

    def row(self, statement: Executable, values: Mapping[str, object] | None = None) -> Any:
        """The one row that a statement finds; None if there is none."""
        with self.reading() as connection:
            return connection.execute(statement, values).one_or_none()

    def rows(self, statement: Executable, values: Mapping[str, object] | None = None) -> list[Any]:
        """All rows that a statement finds."""
        with self.reading() as connection:
            return list(connection.execute(statement, values).all())

    @contextmanager
    def transaction(self, *, durable: bool = True) -> Iterator[Connection]:
        """A connection for statements that are kept together or not at all.

        Args:
            durable: Whether they must survive a power failure: all that is acknowledged.

        Raises:
            StorageUnavailable: The database can't be used now; nothing was kept.
        """
        with self._noting_faults(), self._turn_to_write():
            with self._engine.connect() as connection:
                writing = connection.execution_options(
                    **{DURABILITY: "FULL" if durable else "NORMAL"}
                )
                with writing.begin():
                    yield writing
            self._fault = None

    def probe(self) -> None:
        """See whether the database can be written to.

        Raises:
            StorageUnavailable: It can't.
        """
        with self.transaction(durable=False) as connection:
            connection.execute(text("UPDATE alembic_version SET version_num = version_num"))

    def close(self) -> None:
        """Close all connections; SQLite writes its log back.

        Threads whose callers were cancelled may be in a transaction still: they are waited for.
        """
        end = time.monotonic() + _CLOSING_TIME
        while _in_use(self._engine) and time.monotonic() < end:
            time.sleep(_CLOSING_PERIOD)
        self._engine.dispose()
        self._unlock()

    # ------------------------------------------------------------------------------- faults

    @contextmanager
    def _noting_faults(self) -> Iterator[None]:
        try:
            yield
        except _MISTAKES:
            raise
        except (DBAPIError, PoolTimeout) as error:
            self._fault = _reason(error)
            raise StorageUnavailable(self._fault) from error

    @contextmanager
    def _turn_to_write(self) -> Iterator[None]:
        """The turn of a thread: SQLite lets one write, and is not fair to those that wait."""
        if not self.is_file:
            yield
            return
        if not self._turn.acquire(timeout=_TURN_TIMEOUT):
            raise StorageUnavailable("too many requests wait to write")
        try:
            yield
        finally:
            self._turn.release()

    @property
    def _name(self) -> str:
        return str(self._url.database) if self.is_file else self._url.render_as_string()

    def _unusable(self, error: Exception) -> str:
        reason = _reason(error)
        if self.is_file:
            return (
                f"the database {self._name} can't be used: {reason}. Check that its folder "
                "exists and can be written to and that the disk is not full; if the file is "
                "damaged, move it away or restore a copy. Another folder is chosen with --data-dir "
                "or ARMWRIGHT_DATA_DIR."
            )
        return (
            f"the database {self._name} can't be used: {reason}. Check that "
            "PostgreSQL runs there and that user, password and database are right "
            "(ARMWRIGHT_DATABASE_URL)."
        )

    # ------------------------------------------------------------------------------ opening

    def _lock_file(self) -> FileLock:
        path = Path(self._url.database or "")
        try:
            make_private(path.parent)
            return FileLock(path.with_name(f"{path.name}.lock"))
        except FileLocked:
            raise StoreError(
                f"another server uses the database {path}. Stop it first, choose another folder "
                "with --data-dir or ARMWRIGHT_DATA_DIR, or let several servers share a PostgreSQL "
                "database (ARMWRIGHT_DATABASE_URL)"
            ) from None
        except OSError as error:
            raise StoreError(self._unusable(error)) from error

    def _unlock(self) -> None:
        if self._lock is not None:
            self._lock.release()

    def _connect(self) -> Engine:
        if self.is_file:
            make_private(Path(self._url.database or "").parent)
            return _sqlite_engine(self._url)
        return _postgresql_engine(self._url)


def _parse(text_of_url: str) -> URL:
    try:
        url = make_url(text_of_url)
    except ArgumentError:
        raise StoreError(f"the database URL has no known form; it is {_FORMS}") from None
    if url.drivername == "sqlite" and url.database and not url.host:
        return url
    if url.drivername in ("postgresql", "postgresql+psycopg") and url.database:
        return url.set(drivername="postgresql+psycopg")
    raise StoreError(f"database URL {url.render_as_string()!r}: needed is {_FORMS}")


#: Options of every engine.
_POOL: dict[str, Any] = {
    "pool_size": _CONNECTIONS,
    "pool_timeout": _TURN_TIMEOUT,
    "hide_parameters": True,
}


def _sqlite_engine(url: URL) -> Engine:
    # The driver's own idea of when transactions begin is switched off; `_begin` begins them.
    arguments = {"timeout": _LOCK_TIMEOUT, "isolation_level": None, "check_same_thread": False}
    engine = create_engine(url, connect_args=arguments, max_overflow=0, **_POOL)
    event.listen(engine, "connect", _bound_pages)
    event.listen(engine, "begin", _begin)
    return engine


def _bound_pages(connection: DBAPIConnection, _: object) -> None:
    """Bound the memory of a new connection, which else grows with what is stored to 2 MiB."""
    cursor = connection.cursor()
    cursor.execute(f"PRAGMA cache_size = -{_PAGES_KEPT}")
    cursor.close()


def _in_use(engine: Engine) -> bool:
    """Whether a connection is in a thread's hands."""
    return isinstance(engine.pool, QueuePool) and engine.pool.checkedout() > 0


def _begin(connection: Connection) -> None:
    """Begin a transaction that writes; statements that only read need none."""
    durability = connection.get_execution_options().get(DURABILITY)
    if durability is not None:
        connection.exec_driver_sql(f"PRAGMA synchronous = {durability}")
        connection.exec_driver_sql("BEGIN IMMEDIATE")


def _postgresql_engine(url: URL) -> Engine:
    arguments = {
        "connect_timeout": _CONNECT_TIMEOUT,
        "tcp_user_timeout": _ACKNOWLEDGE_TIMEOUT,
        "options": f"-c statement_timeout={_STATEMENT_TIMEOUT}"
        f" -c lock_timeout={int(1000 * _LOCK_TIMEOUT)}",
    }
    try:
        engine = create_engine(
            url, connect_args=arguments, max_overflow=_CONNECTIONS, pool_pre_ping=True, **_POOL
        )
    except ImportError as error:
        raise StoreError(
            f"the driver for PostgreSQL can't be loaded ({error}). Install it: "
            "pip install 'armwright[postgres]'"
        ) from None
    event.listen(engine, "connect", _compress_quickly)
    return engine


def _compress_quickly(connection: DBAPIConnection, _record: ConnectionPoolEntry) -> None:
    """Have PostgreSQL compress large answers with LZ4, where it can."""
    cursor = connection.cursor()
    cursor.execute(_QUICK_COMPRESSION)
    cursor.close()
    connection.commit()


def _reason(error: Exception) -> str:
    """The words of the driver, in one line."""
    cause = error.orig if isinstance(error, DBAPIError) and error.orig is not None else error
    return " ".join(str(cause).split()) or type(cause).__name__
