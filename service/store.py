"""Storage of documents by name, and of the answers that idempotency keys stand for."""

import hashlib
import json
import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from service.errors import ProblemError

#: How long an idempotency key is remembered [s].
_KEY_LIFETIME = 24 * 3600.0
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
"""


class StoreError(Exception):
    """The storage can't be opened or used; the message says what to do."""


@dataclass(frozen=True, slots=True)
class Record:
    """What is known of a stored document without its content.

    Args:
        name: Unique among its kind.
        hash: SHA-256 of the content.
        version: 1 when created, one more with each replacement.
        created: Seconds since the epoch.
        updated: Seconds since the epoch.
        size: Length of the content [byte].
    """

    name: str
    hash: str
    version: int
    created: float
    updated: float
    size: int


@dataclass(frozen=True, slots=True)
class Document:
    """A stored document."""

    record: Record
    content: bytes


@dataclass(frozen=True, slots=True)
class Recorded:
    """The answer that a request was given."""

    status: int
    headers: dict[str, str]
    body: bytes


class Store(Protocol):
    """What the service needs of a storage; every method blocks and is safe in any thread.

    `kind` is "scene" or "robot".
    """

    def create(self, kind: str, name: str, content: bytes) -> Record:
        """Keep a new document. Raises ProblemError CONFLICT if the name is taken."""

    def replace(self, kind: str, name: str, content: bytes) -> Record:
        """Keep a document, new or in place of the one of that name."""

    def get(self, kind: str, name: str) -> Document:
        """The document of a name. Raises ProblemError NOT_FOUND."""

    def record(self, kind: str, name: str) -> Record:
        """What is known of the document of a name. Raises ProblemError NOT_FOUND."""

    def list(self, kind: str, after: str, limit: int) -> list[Record]:
        """The first `limit` documents whose names sort after `after`, by name."""

    def delete(self, kind: str, name: str) -> None:
        """Forget a document. Raises ProblemError NOT_FOUND."""

    def begin(self, key: str, endpoint: str, request_hash: str) -> Recorded | None:
        """Claim an idempotency key, or give the answer it already stands for.

        Raises ProblemError IDEMPOTENCY_KEY_REUSED if it stands for another request, CONFLICT if
        that request is still being worked on.
        """

    def finish(self, key: str, endpoint: str, answer: Recorded) -> None:
        """Keep the answer a claimed key stands for from now on."""

    def forget(self, key: str, endpoint: str) -> None:
        """Give a claimed key back."""

    def close(self) -> None:
        """Let go of the storage."""


def open_store(url: str) -> Store:
    """The storage a URL names; ``sqlite:///<path>`` is what there is.

    Raises:
        StoreError: The URL is of another kind, or the storage can't be used.
    """
    scheme, separator, path = url.partition(":///")
    if scheme != "sqlite" or not separator or not path:
        raise StoreError(f"database URL {url!r}: only sqlite:///<path> is supported")
    return SqliteStore(Path(path))


class SqliteStore:
    """A store in one SQLite file.

    Write-ahead log with ``synchronous=NORMAL``: a crash of the process loses nothing, a power
    failure at most the last moments, and nothing is ever damaged.

    Raises:
        StoreError: The file can't be made, written or read, or is no database of ours.
    """

    def __init__(self, path: Path) -> None:
        self._lock = threading.Lock()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._database = sqlite3.connect(
                path, timeout=10.0, isolation_level=None, check_same_thread=False
            )
        except (OSError, sqlite3.Error) as error:
            raise StoreError(_unusable(path, error)) from error
        try:
            self._prepare(path)
        except sqlite3.Error as error:
            self._database.close()
            raise StoreError(_unusable(path, error)) from error
        except StoreError:
            self._database.close()
            raise

    def _prepare(self, path: Path) -> None:
        database = self._database
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("PRAGMA synchronous = NORMAL")
        (verdict,) = database.execute("PRAGMA quick_check(1)").fetchone()
        if verdict != "ok":
            raise StoreError(_unusable(path, verdict))
        (version,) = database.execute("PRAGMA user_version").fetchone()
        if version not in (0, _SCHEMA_VERSION):
            raise StoreError(
                f"{path} was written by another version of Armwright (schema {version}, this one "
                f"has {_SCHEMA_VERSION}); use that version or another data folder"
            )
        database.executescript(_SCHEMA)
        database.execute(f"PRAGMA user_version = {_SCHEMA_VERSION}")
        # Whoever claimed these went down with the process before this one.
        database.execute("DELETE FROM answers WHERE status IS NULL")

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        with self._lock:
            self._database.execute("BEGIN IMMEDIATE")
            try:
                yield self._database
            except BaseException:
                self._database.execute("ROLLBACK")
                raise
            self._database.execute("COMMIT")

    def create(self, kind: str, name: str, content: bytes) -> Record:
        """Keep a new document.

        Raises:
            ProblemError: CONFLICT, the name is taken.
        """
        with self._transaction() as database:
            if _find(database, kind, name) is not None:
                raise ProblemError(
                    "CONFLICT",
                    f"there already is a {kind} named {name!r}",
                    stage="storage",
                    hint=f"Choose another name, delete that {kind}, or replace it with PUT.",
                    name=name,
                )
            return _write(database, kind, name, content)

    def replace(self, kind: str, name: str, content: bytes) -> Record:
        """Keep a document, new or in place of the one of that name."""
        with self._transaction() as database:
            return _write(database, kind, name, content)

    def record(self, kind: str, name: str) -> Record:
        """What is known of the document of a name.

        Raises:
            ProblemError: NOT_FOUND.
        """
        with self._lock:
            record = _find(self._database, kind, name)
        if record is None:
            raise _missing(kind, name)
        return record

    def get(self, kind: str, name: str) -> Document:
        """The document of a name.

        Raises:
            ProblemError: NOT_FOUND.
        """
        with self._lock:
            record = _find(self._database, kind, name)
            if record is None:
                raise _missing(kind, name)
            (content,) = self._database.execute(
                "SELECT content FROM documents WHERE kind = ? AND name = ?", (kind, name)
            ).fetchone()
        return Document(record, bytes(content))

    def list(self, kind: str, after: str, limit: int) -> list[Record]:
        """The first `limit` documents whose names sort after `after`, by name."""
        with self._lock:
            rows = self._database.execute(
                f"SELECT {_COLUMNS} FROM documents WHERE kind = ? AND name > ? "
                "ORDER BY name LIMIT ?",
                (kind, after, limit),
            ).fetchall()
        return [Record(*row) for row in rows]

    def delete(self, kind: str, name: str) -> None:
        """Forget a document.

        Raises:
            ProblemError: NOT_FOUND.
        """
        with self._transaction() as database:
            gone = database.execute(
                "DELETE FROM documents WHERE kind = ? AND name = ?", (kind, name)
            )
            if gone.rowcount == 0:
                raise _missing(kind, name)

    def begin(self, key: str, endpoint: str, request_hash: str) -> Recorded | None:
        """Claim an idempotency key, or give the answer it already stands for.

        Raises:
            ProblemError: IDEMPOTENCY_KEY_REUSED, it stands for another request; CONFLICT, that
                request is still being worked on.
        """
        now = time.time()
        with self._transaction() as database:
            database.execute("DELETE FROM answers WHERE created < ?", (now - _KEY_LIFETIME,))
            row = database.execute(
                "SELECT request_hash, status, headers, body FROM answers "
                "WHERE key = ? AND endpoint = ?",
                (key, endpoint),
            ).fetchone()
            if row is None:
                database.execute(
                    "INSERT INTO answers (key, endpoint, request_hash, created) "
                    "VALUES (?, ?, ?, ?)",
                    (key, endpoint, request_hash, now),
                )
                return None
        return _earlier(key, request_hash, *row)

    def finish(self, key: str, endpoint: str, answer: Recorded) -> None:
        """Keep the answer a claimed key stands for from now on."""
        with self._transaction() as database:
            database.execute(
                "UPDATE answers SET status = ?, headers = ?, body = ? "
                "WHERE key = ? AND endpoint = ?",
                (answer.status, json.dumps(answer.headers), answer.body, key, endpoint),
            )

    def forget(self, key: str, endpoint: str) -> None:
        """Give a claimed key back."""
        with self._transaction() as database:
            database.execute("DELETE FROM answers WHERE key = ? AND endpoint = ?", (key, endpoint))

    def close(self) -> None:
        """Write the log back and close the file."""
        with self._lock:
            self._database.close()


_COLUMNS = "name, hash, version, created, updated, length(content)"


def _find(database: sqlite3.Connection, kind: str, name: str) -> Record | None:
    row = database.execute(
        f"SELECT {_COLUMNS} FROM documents WHERE kind = ? AND name = ?", (kind, name)
    ).fetchone()
    return None if row is None else Record(*row)


def _write(database: sqlite3.Connection, kind: str, name: str, content: bytes) -> Record:
    now = time.time()
    digest = hashlib.sha256(content).hexdigest()
    row = database.execute(
        "INSERT INTO documents (kind, name, content, hash, version, created, updated) "
        "VALUES (?, ?, ?, ?, 1, ?, ?) ON CONFLICT (kind, name) DO UPDATE SET "
        "content = excluded.content, hash = excluded.hash, version = version + 1, "
        f"updated = excluded.updated RETURNING {_COLUMNS}",
        (kind, name, content, digest, now, now),
    ).fetchone()
    return Record(*row)


def _missing(kind: str, name: str) -> ProblemError:
    return ProblemError(
        "NOT_FOUND",
        f"there is no {kind} named {name!r}",
        stage="storage",
        hint=f"GET /v1/{kind}s lists those there are.",
        name=name,
    )


def _earlier(
    key: str, request_hash: str, hash_then: str, status: int | None, headers: str, body: bytes
) -> Recorded:
    if request_hash != hash_then:
        raise ProblemError(
            "IDEMPOTENCY_KEY_REUSED",
            f"the Idempotency-Key {key!r} was used for a request with another body",
            stage="request",
            hint="Use a new key for a new request.",
        )
    if status is None:
        raise ProblemError(
            "CONFLICT",
            f"the first request with the Idempotency-Key {key!r} is still being worked on",
            stage="request",
            hint="Ask again in a moment; the answer will be that of the first request.",
            retry_after=1,
        )
    return Recorded(status, json.loads(headers), bytes(body))


def _unusable(path: Path, reason: object) -> str:
    return (
        f"the database {path} can't be used: {reason}. Check that its folder exists and can be "
        "written to and that the disk is not full; if the file is damaged, move it away or restore "
        "a copy. Another folder is chosen with --data-dir or ARMWRIGHT_DATA_DIR."
    )
