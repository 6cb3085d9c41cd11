"""One SQLite file, opened, checked and shared by threads."""

import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: A table that is added leaves the version as it is: other versions pass it over.
_SCHEMA_VERSION = 1
_SCHEMA = """
CREATE TABLE IF NOT EXISTS documents (
    kind TEXT NOT NULL,
    name TEXT NOT NULL,
    content BLOB NOT NULL,
    hash TEXT NOT NULL,
    version INTEGER NOT NULL,
    created REAL NOT NULL,
    updated REAL NOT NULL,
    PRIMARY KEY (kind, name)
);
CREATE TABLE IF NOT EXISTS answers (
    key TEXT NOT NULL,
    endpoint TEXT NOT NULL,
    request_hash TEXT NOT NULL,
    status INTEGER,
    headers TEXT,
    body BLOB,
    created REAL NOT NULL,
    PRIMARY KEY (key, endpoint)
);
CREATE TABLE IF NOT EXISTS jobs (
    id TEXT NOT NULL PRIMARY KEY,
    method TEXT NOT NULL,
    path TEXT NOT NULL,
    content_type TEXT NOT NULL,
    request BLOB,
    status TEXT NOT NULL,
    progress REAL NOT NULL,
    stage TEXT,
    event INTEGER NOT NULL,
    created REAL NOT NULL,
    started REAL,
    ended REAL,
    location TEXT,
    answer_type TEXT,
    answer BLOB
);
CREATE INDEX IF NOT EXISTS jobs_by_status ON jobs (status, ended);
"""


class StoreError(Exception):
    """The storage can't be opened or used; the message says what to do."""


class Database:
    """A connection that threads share.

    Write-ahead log with ``synchronous=NORMAL``: a crash of the process loses nothing, a power
    failure at most the last moments, and nothing is ever damaged.

    Raises:
        StoreError: The file can't be made, written or read, or is no database of ours.
    """

    def __init__(self, path: Path) -> None:
        self._lock = threading.Lock()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._connection = sqlite3.connect(
                path, timeout=10.0, isolation_level=None, check_same_thread=False
            )
        except (OSError, sqlite3.Error) as error:
            raise StoreError(_unusable(path, error)) from error
        try:
            self._prepare(path)
        except sqlite3.Error as error:
            self._connection.close()
            raise StoreError(_unusable(path, error)) from error
        except StoreError:
            self._connection.close()
            raise

    def _prepare(self, path: Path) -> None:
        database = self._connection
        (verdict,) = database.execute("PRAGMA quick_check(1)").fetchone()
        if verdict != "ok":
            raise StoreError(_unusable(path, verdict))
        (version,) = database.execute("PRAGMA user_version").fetchone()
        if version not in (0, _SCHEMA_VERSION):
            raise StoreError(
                f"{path} was written by another version of Armwright (schema {version}, this one "
                f"has {_SCHEMA_VERSION}); use that version or another data folder"
            )
        # From here on the file is changed: it is ours.
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("PRAGMA synchronous = NORMAL")
        database.executescript(_SCHEMA)
        database.execute(f"PRAGMA user_version = {_SCHEMA_VERSION}")
        # Whoever claimed these went down with the process before this one.
        database.execute("DELETE FROM answers WHERE status IS NULL")

    @contextmanager
    def reading(self) -> Iterator[sqlite3.Connection]:
        """The connection, for statements that change nothing."""
        with self._lock:
            yield self._connection

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """The connection, for statements that are kept together or not at all."""
        with self._lock:
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                yield self._connection
            except BaseException:
                self._connection.execute("ROLLBACK")
                raise
            self._connection.execute("COMMIT")

    def close(self) -> None:
        """Write the log back and close the file."""
        with self._lock:
            self._connection.close()


def _unusable(path: Path, reason: object) -> str:
    return (
        f"the database {path} can't be used: {reason}. Check that its folder exists and can be "
        "written to and that the disk is not full; if the file is damaged, move it away or restore "
        "a copy. Another folder is chosen with --data-dir or ARMWRIGHT_DATA_DIR."
    )
