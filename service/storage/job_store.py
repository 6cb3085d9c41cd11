"""Jobs as they are stored: the request, where it stands, and what it was answered."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

from service.problem import ProblemError
from service.storage.database import Database

Status = Literal["queued", "running", "succeeded", "failed", "cancelled"]
STATUSES: tuple[Status, ...] = ("queued", "running", "succeeded", "failed", "cancelled")
#: Those that nothing comes after.
ENDED: tuple[Status, ...] = ("succeeded", "failed", "cancelled")


@dataclass(frozen=True, slots=True)
class StoredRequest:
    """The request that a job answers.

    Args:
        method: Of HTTP.
        path: That was asked.
        content_type: Of the body.
        body: As it came.
    """

    method: str
    path: str
    content_type: str
    body: bytes


@dataclass(frozen=True, slots=True)
class JobRecord:
    """Status of a job.

    Args:
        id: By which it is asked for; later jobs sort after earlier ones.
        method: Of its request.
        path: Of its request.
        status: queued, running, succeeded, failed or cancelled.
        progress: From 0 to 1.
        stage: What is being done.
        event: The number of the last event.
        created: Seconds since the epoch, as the next two.
        started: When a worker first took it up.
        ended: When it succeeded, failed or was cancelled.
        location: What it created.
    """

    id: str
    method: str
    path: str
    status: Status
    progress: float = 0.0
    stage: str | None = None
    event: int = 0
    created: float = 0.0
    started: float | None = None
    ended: float | None = None
    location: str | None = None


@dataclass(frozen=True, slots=True)
class JobAnswer:
    """Answer to a job's request: a result, or a problem document."""

    content_type: str
    content: bytes


class JobStore(Protocol):
    """Interface of a job storage; every method blocks and is safe in any thread."""

    def add(self, record: JobRecord, request: StoredRequest | None) -> None:
        """Keep a new job."""

    def get(self, job_id: str) -> tuple[JobRecord, JobAnswer | None]:
        """A job and its answer, once there is one. Raises ProblemError NOT_FOUND."""

    def request(self, job_id: str) -> StoredRequest:
        """The request of a job that has not ended. Raises ProblemError NOT_FOUND."""

    def update(self, record: JobRecord, answer: JobAnswer | None = None) -> None:
        """Keep where a job stands now; of one that has ended the request is forgotten."""

    def list(self, status: Status | None, before: str, limit: int) -> list[JobRecord]:
        """The last `limit` jobs whose ids sort before `before`, newest first."""

    def with_status(self, status: Status) -> Sequence[JobRecord]:
        """All jobs of a status, oldest first."""

    def counts(self) -> dict[Status, int]:
        """Number of jobs of each status."""

    def purge(self, ended_before: float, count: int, size: int) -> None:
        """Forget ended jobs that are too old, and the oldest of too many or too large answers."""


_COLUMNS = ", ".join(field.name for field in dataclasses.fields(JobRecord))
_ENDED = ", ".join(f"'{status}'" for status in ENDED)


class SqliteJobs:
    """Jobs in a SQLite file."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, record: JobRecord, request: StoredRequest | None) -> None:
        """Keep a new job."""
        values = dataclasses.astuple(record)
        marks = ", ".join("?" for _ in values)
        content_type = "" if request is None else request.content_type
        body = None if request is None else request.body
        with self._database.transaction() as database:
            database.execute(
                f"INSERT INTO jobs ({_COLUMNS}, content_type, request) VALUES ({marks}, ?, ?)",
                (*values, content_type, body),
            )

    def get(self, job_id: str) -> tuple[JobRecord, JobAnswer | None]:
        """A job and its answer, once there is one.

        Raises:
            ProblemError: NOT_FOUND.
        """
        with self._database.reading() as database:
            row = database.execute(
                f"SELECT {_COLUMNS}, answer_type, answer FROM jobs WHERE id = ?", (job_id,)
            ).fetchone()
        if row is None:
            raise no_job(job_id)
        *values, content_type, content = row
        answer = None if content_type is None else JobAnswer(content_type, bytes(content))
        return JobRecord(*values), answer

    def request(self, job_id: str) -> StoredRequest:
        """The request of a job that has not ended.

        Raises:
            ProblemError: NOT_FOUND.
        """
        with self._database.reading() as database:
            row = database.execute(
                "SELECT method, path, content_type, request FROM jobs "
                "WHERE id = ? AND request IS NOT NULL",
                (job_id,),
            ).fetchone()
        if row is None:
            raise no_job(job_id)
        method, path, content_type, body = row
        return StoredRequest(method, path, content_type, bytes(body))

    def update(self, record: JobRecord, answer: JobAnswer | None = None) -> None:
        """Keep where a job stands now; of one that has ended the request is forgotten."""
        values = dataclasses.astuple(record)
        changes = ", ".join(f"{field.name} = ?" for field in dataclasses.fields(record))
        ended = record.status in ENDED
        forgotten = ", request = NULL" if ended else ""
        answered = (None, None) if answer is None else (answer.content_type, answer.content)
        with self._database.transaction() as database:
            database.execute(
                f"UPDATE jobs SET {changes}, answer_type = ?, answer = ?{forgotten} WHERE id = ?",
                (*values, *answered, record.id),
            )

    def list(self, status: Status | None, before: str, limit: int) -> list[JobRecord]:
        """The last `limit` jobs whose ids sort before `before`, newest first."""
        conditions = ["1"]
        values: list[str | int] = []
        if before:
            conditions.append("id < ?")
            values.append(before)
        if status is not None:
            conditions.append("status = ?")
            values.append(status)
        with self._database.reading() as database:
            rows = database.execute(
                f"SELECT {_COLUMNS} FROM jobs WHERE {' AND '.join(conditions)} "
                "ORDER BY id DESC LIMIT ?",
                (*values, limit),
            ).fetchall()
        return [JobRecord(*row) for row in rows]

    def with_status(self, status: Status) -> Sequence[JobRecord]:
        """All jobs of a status, oldest first."""
        with self._database.reading() as database:
            rows = database.execute(
                f"SELECT {_COLUMNS} FROM jobs WHERE status = ? ORDER BY id", (status,)
            ).fetchall()
        return [JobRecord(*row) for row in rows]

    def counts(self) -> dict[Status, int]:
        """Number of jobs of each status."""
        with self._database.reading() as database:
            rows = database.execute("SELECT status, COUNT(*) FROM jobs GROUP BY status").fetchall()
        found: dict[Status, int] = dict(rows)
        return {status: found.get(status, 0) for status in STATUSES}

    def purge(self, ended_before: float, count: int, size: int) -> None:
        """Forget ended jobs that are too old, and the oldest of too many or too large answers."""
        with self._database.transaction() as database:
            database.execute(
                f"DELETE FROM jobs WHERE status IN ({_ENDED}) AND ended < ?", (ended_before,)
            )
            # The newest one stays, however large it is: somebody is about to ask for it.
            database.execute(
                "DELETE FROM jobs WHERE id IN (SELECT id FROM (SELECT id, "
                "ROW_NUMBER() OVER newest AS place, SUM(LENGTH(answer)) OVER newest AS total "
                f"FROM jobs WHERE status IN ({_ENDED}) WINDOW newest AS (ORDER BY ended DESC, id "
                "DESC)) WHERE place > ? OR (total > ? AND place > 1))",
                (count, size),
            )


def no_job(job_id: str) -> ProblemError:
    """The problem of a job that is not there."""
    return ProblemError(
        "NOT_FOUND",
        f"there is no job {job_id[:100]!r}",
        stage="storage",
        hint="GET /v1/jobs lists those there are; ended ones are forgotten after a while.",
    )
