"""Jobs that agents work on: claimed by one at a time, and batches of them cut into chunks."""

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass

from sqlalchemy import bindparam, delete, func, insert, or_, select, update

from service.storage.database import Database
from service.storage.messages import CHUNK_PRIORITY, add_messages
from service.storage.stores.job_store import ENDED, HAS_ENDED, RECORD, JobRecord
from service.storage.stores.server_store import is_abandoned
from service.storage.tables import jobs

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
_DELETE_CHUNKS = delete(jobs).where(jobs.c.parent == bindparam("of_id"))
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
