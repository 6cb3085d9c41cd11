"""Storage of documents by name, and of the answers that idempotency keys stand for."""

import hashlib
import json
import sqlite3
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from service.problem import ProblemError
from service.storage.database import Database, StoreError
from service.storage.job_store import JobStore, SqliteJobs

#: How long an idempotency key is remembered [s].
_KEY_LIFETIME = 24 * 3600.0


@dataclass(frozen=True, slots=True)
class Record:
    """Metadata of a stored document.

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
    """Interface of a document storage; every method blocks and is safe in any thread.

    `kind` is "scene" or "robot"; `jobs` are kept beside the documents.
    """

    jobs: JobStore

    def create(self, kind: str, name: str, content: bytes) -> Record:
        """Keep a new document. Raises ProblemError CONFLICT if the name is taken."""

    def replace(self, kind: str, name: str, content: bytes) -> Record:
        """Keep a document, new or in place of the one of that name."""

    def get(self, kind: str, name: str) -> Document:
        """The document of a name. Raises ProblemError NOT_FOUND."""

    def record(self, kind: str, name: str) -> Record:
        """Metadata of the document of a name. Raises ProblemError NOT_FOUND."""

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

    Raises:
        StoreError: The file can't be made, written or read, or is no database of ours.
    """

    def __init__(self, path: Path) -> None:
        self._database = Database(path)
        self.jobs: JobStore = SqliteJobs(self._database)

    def create(self, kind: str, name: str, content: bytes) -> Record:
        """Keep a new document.

        Raises:
            ProblemError: CONFLICT, the name is taken.
        """
        with self._database.transaction() as database:
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
        with self._database.transaction() as database:
            return _write(database, kind, name, content)

    def record(self, kind: str, name: str) -> Record:
        """Metadata of the document of a name.

        Raises:
            ProblemError: NOT_FOUND.
        """
        with self._database.reading() as database:
            record = _find(database, kind, name)
        if record is None:
            raise _not_found(kind, name)
        return record

    def get(self, kind: str, name: str) -> Document:
        """The document of a name.

        Raises:
            ProblemError: NOT_FOUND.
        """
        with self._database.reading() as database:
            record = _find(database, kind, name)
            if record is None:
                raise _not_found(kind, name)
            (content,) = database.execute(
                "SELECT content FROM documents WHERE kind = ? AND name = ?", (kind, name)
            ).fetchone()
        return Document(record, bytes(content))

    def list(self, kind: str, after: str, limit: int) -> list[Record]:
        """The first `limit` documents whose names sort after `after`, by name."""
        with self._database.reading() as database:
            rows = database.execute(
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
        with self._database.transaction() as database:
            gone = database.execute(
                "DELETE FROM documents WHERE kind = ? AND name = ?", (kind, name)
            )
            if gone.rowcount == 0:
                raise _not_found(kind, name)

    def begin(self, key: str, endpoint: str, request_hash: str) -> Recorded | None:
        """Claim an idempotency key, or give the answer it already stands for.

        Raises:
            ProblemError: IDEMPOTENCY_KEY_REUSED, it stands for another request; CONFLICT, that
                request is still being worked on.
        """
        now = time.time()
        with self._database.transaction() as database:
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
        with self._database.transaction() as database:
            database.execute(
                "UPDATE answers SET status = ?, headers = ?, body = ? "
                "WHERE key = ? AND endpoint = ?",
                (answer.status, json.dumps(answer.headers), answer.body, key, endpoint),
            )

    def forget(self, key: str, endpoint: str) -> None:
        """Give a claimed key back."""
        with self._database.transaction() as database:
            database.execute("DELETE FROM answers WHERE key = ? AND endpoint = ?", (key, endpoint))

    def close(self) -> None:
        """Write the log back and close the file."""
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


def _not_found(kind: str, name: str) -> ProblemError:
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
