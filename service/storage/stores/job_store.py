"""Jobs that agents work on: claimed by one at a time, and batches of them cut into chunks.

Jobs as they are stored: the request, where it stands, and what it was answered.
"""

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from sqlalchemy import bindparam, delete, exists, func, insert, or_, select, update

from service.storage.database import Database
from service.storage.messages import CHUNK_PRIORITY, JOB_PRIORITY, add_messages
from service.storage.stores.idempotency_store import KeptAnswer, keep_answer
from service.storage.stores.server_store import is_abandoned
from service.storage.tables import DEFAULT_TENANT, jobs, superfluous
from service.validation import ProblemError, storage_problem

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
_DELETE_CHUNKS = delete(jobs).where(jobs.c.parent == bindparam("of_id"))
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
                connection.execute(_DELETE_CHUNKS, {"of_id": job_id})
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


#: `jobs.carrier` of the jobs that agents work on.
AGENTS = "agents"
#: Stands between the id of a batch and the number of its chunk.
_PART = "-"


#: Neighbouring problems of a batch: index of the first one, how many they are, and their request.
Chunk = tuple[int, int, bytes]


@dataclass(frozen=True, slots=True)
class ChunkAnswer:
    """The answer to a chunk.

    Args:
        first: Index of its first problem in the whole batch.
        size: How many they are.
        has_succeeded: Whether the answer is that of a batch, and not a problem document.
        content: The answer, JSON.
    """

    first: int
    size: int
    has_succeeded: bool
    content: bytes


@dataclass(frozen=True, slots=True)
class Load:
    """Jobs for agents that have not ended.

    Args:
        count: How many there are.
        of_key: How many of them have the API key that was asked for.
        size: Size of their requests [byte].
    """

    count: int
    of_key: int
    size: int


_OPEN = (jobs.c.id == bindparam("of_id"), ~HAS_ENDED)
#: A batch that was cut is worked on as its chunks.
_IS_WHOLE = or_(jobs.c.parent.is_not(None), jobs.c.size.is_(None))
_IS_OPEN = select(jobs.c.id).where(*_OPEN, _IS_WHOLE)
_CUT = (
    update(jobs)
    .where(*_OPEN, jobs.c.server == bindparam("of_server"))
    .values(
        status="running", stage=bindparam("new_stage"), size=bindparam("new_size"), server=None,
        started=bindparam("now"), event=jobs.c.event + 1,
    )
)  # fmt: skip
_PARENT = select(*RECORD).where(*_OPEN).with_for_update()
_STATUS = select(jobs.c.status).where(jobs.c.id == bindparam("of_id")).with_for_update()
_END = (
    update(jobs)
    .where(*_OPEN)
    .values(
        status="succeeded", progress=1.0, event=jobs.c.event + 1, ended=bindparam("now"),
        request=None,
    )
)  # fmt: skip
_OPEN_CHUNKS = (
    select(func.count()).select_from(jobs).where(jobs.c.parent == bindparam("of_id"), ~HAS_ENDED)
)
#: For the driver itself, which answers bytes as bytes if asked to, and else as text of twice the
#: length.
_CHUNKS = b"SELECT first, size, status, answer FROM jobs WHERE parent = %s ORDER BY first"
_DONE = select(func.sum(jobs.c.progress * jobs.c.size)).where(jobs.c.parent == bindparam("of_id"))


class QueueStore:
    """Jobs for agents in a PostgreSQL database; every method blocks and is safe in any thread.

    Args:
        database: Database of the table.
        server: The agent that claims jobs.
    """

    def __init__(self, database: Database, server: str) -> None:
        self._database = database
        self._server = server
        self._is_free = is_abandoned(database, jobs.c.server, server) | (jobs.c.server == server)

    def claim(self, job_id: str) -> JobRecord | None:
        """Take a job that no other living agent works on; None if there is none.

        A batch that was cut into chunks is not taken any more.
        """
        claimed = update(jobs).where(*_OPEN, _IS_WHOLE, self._is_free).values(server=self._server)
        with self._database.transaction(durable=False) as connection:
            parameters = {"of_id": job_id}
            row = connection.execute(claimed.returning(*RECORD), parameters).one_or_none()
        return None if row is None else JobRecord(*row)

    def is_open(self, job_id: str) -> bool:
        """Whether there is work on a job left, whoever does it."""
        return self._database.row(_IS_OPEN, {"of_id": job_id}) is not None

    def load(self, api_key: str | None) -> Load:
        """Jobs of all servers that wait for agents or that these work on.

        Args:
            api_key: API key whose jobs are counted apart.
        """
        own = jobs.c.api_key.is_(None) if api_key is None else jobs.c.api_key == api_key
        counted = select(
            func.count(), func.count().filter(own), func.sum(func.length(jobs.c.request))
        ).where(~HAS_ENDED, jobs.c.carrier == AGENTS, jobs.c.parent.is_(None))
        count, of_key, size = self._database.row(counted)
        return Load(count, of_key, int(size or 0))

    # ------------------------------------------------------------------------------- chunks

    def cut(self, record: JobRecord, chunks: Sequence[Chunk]) -> bool:
        """Replace the work on a batch by that on its chunks.

        Args:
            record: The batch, which this agent has.
            chunks: Chunks in order.

        Returns:
            False if another agent has the batch by now, or it has ended: nothing was kept.
        """
        size = sum(count for _, count, _ in chunks)
        values = {"new_stage": _stage(0, size), "new_size": size, "now": time.time()}
        rows = [_row(record, number, chunk) for number, chunk in enumerate(chunks)]
        with self._database.transaction() as connection:
            parameters = {"of_id": record.id, "of_server": self._server} | values
            if connection.execute(_CUT, parameters).rowcount != 1:
                return False
            connection.execute(insert(jobs), rows)
            add_messages(connection, [f"{row['id']}" for row in rows], CHUNK_PRIORITY)
        return True

    def report(self, batch: str) -> None:
        """Note how far the chunks of a batch have come, all together."""
        with self._database.transaction(durable=False) as connection:
            row = connection.execute(_PARENT, {"of_id": batch}).one_or_none()
            if row is None:
                return
            record = JobRecord(*row)
            size = record.size or 1
            done = float(connection.execute(_DONE, {"of_id": batch}).scalar() or 0.0)
            progress = max(record.progress, min(done / size, 1.0))
            values = {"progress": progress, "stage": _stage(int(done), size)}
            if (progress, values["stage"]) == (record.progress, record.stage):
                return
            further = update(jobs).where(*_OPEN).values(event=jobs.c.event + 1, **values)
            connection.execute(further, {"of_id": batch})

    def join(self, batch: str) -> bool:
        """End a batch if all its chunks have ended; its answer is theirs, one after another.

        They stay as they are: to write the whole answer, tens of megabytes, once more would take
        the database and the agent as long as hundreds of plans.

        Args:
            batch: The id of the batch.

        Returns:
            Whether the batch has ended, by this call or before.
        """
        parameters = {"of_id": batch}
        with self._database.transaction() as connection:
            status = connection.execute(_STATUS, parameters).scalar_one_or_none()
            if status == "succeeded":
                return True
            if status is None or status in ENDED:
                connection.execute(_DELETE_CHUNKS, parameters)
                return True
            if connection.execute(_OPEN_CHUNKS, parameters).scalar_one() > 0:
                return False
            connection.execute(_END, parameters | {"now": time.time()})
        return True

    def chunk_answers(self, batch: str) -> list[ChunkAnswer]:
        """The answers to the chunks of a batch that has succeeded, in order."""
        with self._database.reading() as connection:
            driver = connection.connection.driver_connection
            assert driver is not None
            with driver.cursor(binary=True) as cursor:
                rows = cursor.execute(_CHUNKS, (batch,)).fetchall()
        return [
            ChunkAnswer(first, size, status == "succeeded", bytes(content or b""))
            for first, size, status, content in rows
        ]


def batch_of(job_id: str) -> str | None:
    """The id of the batch that a chunk is a part of; None where an id is not that of a chunk."""
    batch, is_chunk, _ = job_id.partition(_PART)
    return batch if is_chunk else None


def _stage(done: int, size: int) -> str:
    return f"{done} of {size} problems"


def _row(batch: JobRecord, number: int, chunk: Chunk) -> dict[str, object]:
    """The row of a chunk, which is a job that waits."""
    first, size, body = chunk
    record = dataclasses.replace(
        batch, id=f"{batch.id}{_PART}{number}", status="queued", progress=0.0, stage=None, event=1,
        started=None, attempt=1, parent=batch.id, first=first, size=size,
    )  # fmt: skip
    content = {"content_type": "application/json", "request": body, "server": None}
    return dataclasses.asdict(record) | content
