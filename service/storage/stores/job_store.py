"""Jobs as they are stored: the request, where it stands, and what it was answered."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from sqlalchemy import bindparam, delete, exists, func, insert, select, update

from service.problem import ProblemError, storage_problem
from service.storage.database import Database
from service.storage.messages import JOB_PRIORITY, add_messages
from service.storage.stores.idempotency_store import KeptAnswer, keep_answer
from service.storage.stores.server_store import is_abandoned
from service.storage.tables import DEFAULT_TENANT, jobs, superfluous

Status = Literal["queued", "running", "succeeded", "failed", "cancelled"]
STATUSES: tuple[Status, ...] = ("queued", "running", "succeeded", "failed", "cancelled")
#: Those that nothing comes after.
ENDED: tuple[Status, ...] = ("succeeded", "failed", "cancelled")


@dataclass(frozen=True, slots=True)
class StoredRequest:
    """The request that a job answers.

    Args:
        method: Method of HTTP.
        path: Path that was asked.
        content_type: Content type of the body.
        body: Body as it came.
    """

    method: str
    path: str
    content_type: str
    body: bytes


@dataclass(frozen=True, slots=True)
class JobRecord:
    """Status of a job.

    Args:
        id: Id by which it is asked for; later jobs sort after earlier ones.
        method: Method of the request.
        path: Path of the request.
        status: queued, running, succeeded, failed or cancelled.
        progress: Progress from 0 to 1.
        stage: Stage of the work.
        event: The number of the last event.
        created: Seconds since the epoch, as the next two.
        started: Time at which a worker first took the job up.
        ended: Time at which the job succeeded, failed or was cancelled.
        location: Path of the resource that the job created.
        tenant: Tenant who owns the job.
        api_key: Id of the key of its caller, if there was one.
        attempt: Counts the servers that have had it in work, from 1.
        carrier: "agents" if agents work on it, None if servers do.
        parent: Parent of a chunk, the batch that it is a part of.
        first: Index of the first problem of a chunk in the batch.
        size: Problems of a chunk, or of a batch that was cut into chunks.
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
    tenant: str = DEFAULT_TENANT
    api_key: str | None = None
    attempt: int = 1
    carrier: str | None = None
    parent: str | None = None
    first: int | None = None
    size: int | None = None

    @property
    def is_answered_in_chunks(self) -> bool:
        """Whether it is a batch whose answer is that of its chunks, one after another."""
        return self.parent is None and self.size is not None and self.status == "succeeded"


@dataclass(frozen=True, slots=True)
class JobAnswer:
    """Answer to a job's request: a result, or a problem document."""

    content_type: str
    content: bytes


#: Columns of a `JobRecord`.
RECORD = tuple(jobs.c[field.name] for field in dataclasses.fields(JobRecord))
_INSERT = insert(jobs)
_GET = select(*RECORD, jobs.c.answer_type, jobs.c.answer).where(jobs.c.id == bindparam("of_id"))
_REQUEST = select(jobs.c.method, jobs.c.path, jobs.c.content_type, jobs.c.request).where(
    jobs.c.id == bindparam("of_id"), jobs.c.request.is_not(None)
)
_IS_CHUNK = jobs.c.parent.is_not(None)
_COUNTS = select(jobs.c.status, func.count()).where(~_IS_CHUNK).group_by(jobs.c.status)
#: Whether nothing comes after the status of a row.
HAS_ENDED = jobs.c.status.in_(ENDED)
# Late answers of a server that was taken for dead, or of a job that was cancelled, change nothing.
_UPDATE = update(jobs).where(
    jobs.c.id == bindparam("of_id"), jobs.c.server == bindparam("of_server"), ~HAS_ENDED
)
_CANCEL = (
    update(jobs)
    .where(jobs.c.id == bindparam("of_id"), ~HAS_ENDED)
    .values(status="cancelled", ended=bindparam("now"), event=jobs.c.event + 1, request=None)
    .returning(*RECORD)
)
_CANCEL_CHUNKS = delete(jobs).where(jobs.c.parent == bindparam("of_id"))
_CHUNK, _BATCH = jobs.alias("chunk"), jobs.alias("batch")
_SIZE_OF_CHUNKS = (
    select(func.sum(func.length(_CHUNK.c.answer)))
    .where(_CHUNK.c.parent == jobs.c.id)
    .correlate(jobs)
    .scalar_subquery()
)
_HAS_BATCH = exists().where(_BATCH.c.id == jobs.c.parent)
_DELETE_LEFT_CHUNKS = delete(jobs).where(_IS_CHUNK, ~_HAS_BATCH)
_OUTDATED = delete(jobs).where(HAS_ENDED, ~_IS_CHUNK, jobs.c.ended < bindparam("oldest"))


class JobStore:
    """Jobs in a database; every method blocks and is safe in any thread.

    Args:
        database: Database of the table.
        server: Server that works on jobs that are added or adopted.
    """

    def __init__(self, database: Database, server: str) -> None:
        self._database = database
        self._server = server
        self._is_abandoned = is_abandoned(database, jobs.c.server, server)

    def add(
        self,
        record: JobRecord,
        content: StoredRequest | JobAnswer,
        told: KeptAnswer[JobRecord] | None = None,
    ) -> None:
        """Keep a new job, and in the same transaction what its caller is told.

        Args:
            record: The job.
            content: Request of the job, or its answer if it has ended already.
            told: Answer that the idempotency key of the request stands for from then on.
        """
        values = dataclasses.asdict(record)
        values["server"] = None if record.carrier else self._server
        if isinstance(content, StoredRequest):
            values |= {"content_type": content.content_type, "request": content.body}
        else:
            values |= {"content_type": "", "answer_type": content.content_type}
            values["answer"] = content.content
        with self._database.transaction() as connection:
            connection.execute(_INSERT, values)
            if record.carrier and record.status not in ENDED:
                add_messages(connection, [record.id], JOB_PRIORITY)
            if told is not None:
                keep_answer(connection, told.key, told.of(record))

    def get(self, job_id: str) -> tuple[JobRecord, JobAnswer | None]:
        """A job and its answer, once there is one and unless it is in its chunks.

        Raises:
            ProblemError: NOT_FOUND.
        """
        row = self._database.row(_GET, {"of_id": job_id})
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
        row = self._database.row(_REQUEST, {"of_id": job_id})
        if row is None:
            raise no_job(job_id)
        method, path, content_type, body = row
        return StoredRequest(method, path, content_type, bytes(body))

    def update(self, record: JobRecord, answer: JobAnswer | None = None) -> bool:
        """Keep where a job of this server stands now; of one that has ended forget the request.

        Returns:
            False if the job has ended already or is another server's by now: nothing was kept.
        """
        values: dict[str, Any] = dataclasses.asdict(record)
        del values["id"]
        values["answer_type"] = None if answer is None else answer.content_type
        values["answer"] = None if answer is None else answer.content
        if record.status in ENDED:
            values["request"] = None
        # Of a job that has not ended nothing is lost: it begins anew.
        with self._database.transaction(durable=record.status in ENDED) as connection:
            parameters = {"of_id": record.id, "of_server": self._server} | values
            return connection.execute(_UPDATE, parameters).rowcount == 1

    def cancel(self, job_id: str, ended: float) -> JobRecord | None:
        """End a job, whichever server works on it; None if it has ended already."""
        with self._database.transaction() as connection:
            row = connection.execute(_CANCEL, {"of_id": job_id, "now": ended}).one_or_none()
            if row is not None:  # else they may be its answer
                connection.execute(_CANCEL_CHUNKS, {"of_id": job_id})
        return None if row is None else JobRecord(*row)

    def adopt(self, limit: int) -> list[JobRecord]:
        """Take over jobs that no living server works on, the oldest first.

        Args:
            limit: How many at most.
        """
        abandoned = (
            select(jobs.c.id)
            .where(~HAS_ENDED, jobs.c.carrier.is_(None), self._is_abandoned)
            .order_by(jobs.c.id)
            .limit(limit)
            .with_for_update(skip_locked=True)
        )
        adopted = update(jobs).where(jobs.c.id.in_(abandoned)).values(server=self._server)
        with self._database.transaction(durable=False) as connection:
            rows = connection.execute(adopted.returning(*RECORD)).all()
        return sorted((JobRecord(*row) for row in rows), key=lambda record: record.id)

    def taken_away(self, ids: Sequence[str]) -> set[str]:
        """Jobs, of those given, that ended by another's hand or that another server has."""
        mine = select(jobs.c.id).where(
            jobs.c.id.in_(ids), ~HAS_ENDED, jobs.c.server == self._server
        )
        with self._database.reading() as connection:
            return set(ids) - set(connection.execute(mine).scalars())

    def release(self, record: JobRecord) -> None:
        """Give a job back, for whichever server takes it next."""
        values = {"status": record.status, "progress": record.progress, "stage": record.stage}
        values |= {"started": record.started, "event": record.event, "server": None}
        with self._database.transaction(durable=False) as connection:
            parameters = {"of_id": record.id, "of_server": self._server} | values
            connection.execute(_UPDATE, parameters)

    def list(
        self, status: Status | None, before: str, limit: int, tenant: str | None = None
    ) -> list[JobRecord]:
        """The last `limit` jobs whose ids sort before `before`, newest first.

        Args:
            status: Only these.
            before: An id, or nothing.
            limit: How many at most.
            tenant: Only those of one; all if left out.
        """
        chosen = select(*RECORD).where(~_IS_CHUNK).order_by(jobs.c.id.desc()).limit(limit)
        if before:
            chosen = chosen.where(jobs.c.id < before.partition("\0")[0])
        if status is not None:
            chosen = chosen.where(jobs.c.status == status)
        if tenant is not None:
            chosen = chosen.where(jobs.c.tenant == tenant)
        return [JobRecord(*row) for row in self._database.rows(chosen)]

    def counts(self, tenant: str | None = None) -> dict[Status, int]:
        """Number of jobs of each status.

        Args:
            tenant: Only those of one; all if left out.
        """
        chosen = _COUNTS if tenant is None else _COUNTS.where(jobs.c.tenant == tenant)
        rows = self._database.rows(chosen)
        counts: dict[Status, int] = dict(tuple(row) for row in rows)
        return {status: counts.get(status, 0) for status in STATUSES}

    def purge(self, ended_before: float, count: int, size: int) -> None:
        """Forget ended jobs that are too old, and the oldest of too many or too large of a tenant.

        Args:
            ended_before: Seconds since the epoch.
            count: How many of each tenant may stay.
            size: How large the answers of each may be together [byte].
        """
        bytes_of = func.coalesce(func.length(jobs.c.answer), _SIZE_OF_CHUNKS)
        ended = HAS_ENDED & ~_IS_CHUNK
        too_many = superfluous(jobs, jobs.c.ended, bytes_of, count, size, ended)
        with self._database.transaction() as connection:
            connection.execute(_OUTDATED, {"oldest": ended_before})
            connection.execute(delete(jobs).where(jobs.c.id.in_(too_many)))
            connection.execute(_DELETE_LEFT_CHUNKS)


def no_job(job_id: str) -> ProblemError:
    """The problem of a job that is not there."""
    return storage_problem(
        "NOT_FOUND",
        f"there is no job {job_id[:100]!r}",
        hint="GET /v1/jobs lists those there are; ended ones are forgotten after a while.",
    )
