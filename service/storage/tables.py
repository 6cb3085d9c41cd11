"""Tables of the database, for SQLite and PostgreSQL alike."""

from typing import Any

from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    ColumnElement,
    Double,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    PrimaryKeyConstraint,
    Select,
    Table,
    Text,
    false,
    func,
    select,
    true,
)

#: Revisions of the schema, the oldest first: the names of the migrations.
REVISIONS = ("0001", "0002", "0003", "0004", "0005", "0006", "0007", "0008")
METADATA = MetaData()
_EVERY = true()
#: Whose robots, scenes and jobs those are that came without an API key.
DEFAULT_TENANT = "default"
#: Text that sorts by code points in every database, as Python sorts it.
SORTED_TEXT = Text().with_variant(Text(collation="C"), "postgresql")


def texts(*names: str) -> list[Column[str]]:
    """Columns of texts that are never absent."""
    return [Column(name, Text, nullable=False) for name in names]


#: Robots and scenes.
documents = Table(
    "documents",
    METADATA,
    *texts("tenant", "kind"),
    Column("name", SORTED_TEXT, nullable=False),
    Column("content", LargeBinary, nullable=False),
    *texts("hash"),
    Column("version", Integer, nullable=False),
    Column("created", Double, nullable=False),
    Column("updated", Double, nullable=False),
    PrimaryKeyConstraint("tenant", "kind", "name"),
)

#: Answers of idempotency keys; without a status the first request is still being worked on.
answers = Table(
    "answers",
    METADATA,
    *texts("tenant", "key", "endpoint", "request_hash"),
    Column("status", Integer),
    Column("headers", Text),
    Column("body", LargeBinary),
    Column("created", Double, nullable=False),
    #: Of a claimed key: the server that works on its request.
    Column("server", Text),
    PrimaryKeyConstraint("tenant", "key", "endpoint"),
)

#: Requests that are answered later, and their answers.
jobs = Table(
    "jobs",
    METADATA,
    Column("id", SORTED_TEXT, primary_key=True),
    Column("tenant", Text, nullable=False, server_default=DEFAULT_TENANT),
    *texts("method", "path", "content_type"),
    Column("request", LargeBinary),
    *texts("status"),
    Column("progress", Double, nullable=False),
    Column("stage", Text),
    Column("event", Integer, nullable=False),
    Column("created", Double, nullable=False),
    Column("started", Double),
    Column("ended", Double),
    Column("location", Text),
    Column("answer_type", Text),
    Column("answer", LargeBinary),
    #: The server that has queued it or works on it.
    Column("server", Text),
    #: The key of its caller.
    Column("api_key", Text),
    Column("attempt", Integer, nullable=False, server_default="1"),
    #: "agents" if a queue carries it to agents; servers that accepted it run it otherwise.
    Column("carrier", Text),
    #: Of a chunk: the batch that it is a part of, and the index of its first problem there.
    Column("parent", SORTED_TEXT),
    Column("first", Integer),
    #: Problems of a chunk, or of a batch that was cut into chunks.
    Column("size", Integer),
)
Index("jobs_by_status", jobs.c.status, jobs.c.ended)
Index("jobs_by_tenant", jobs.c.tenant, jobs.c.id)
Index("jobs_by_parent", jobs.c.parent)

#: Kept requests with their answers or problems, see `plan_store.PlanRecord`.
plans = Table(
    "plans",
    METADATA,
    Column("id", SORTED_TEXT, primary_key=True),
    *texts("tenant"),
    Column("api_key", Text),
    *texts("method", "path"),
    Column("request", LargeBinary, nullable=False),
    Column("status", Integer, nullable=False),
    Column("code", Text),
    Column("answer", LargeBinary, nullable=False),
    Column("robot", Text),
    Column("robot_hash", Text),
    Column("scene", Text),
    Column("scene_hash", Text),
    Column("seed", BigInteger),
    *texts("version", "digest"),
    Column("created", Double, nullable=False),
    Column("job", Text),
    Column("replay_of", Text),
    Column("proved_here", Boolean, nullable=False, server_default=false()),
)
Index("plans_by_tenant", plans.c.tenant, plans.c.id)

#: Documents of robots and scenes that kept plans refer to, by content hash.
plan_documents = Table(
    "plan_documents",
    METADATA,
    *texts("tenant", "hash"),
    Column("content", LargeBinary, nullable=False),
    PrimaryKeyConstraint("tenant", "hash"),
)

#: Servers that share the database.
servers = Table(
    "servers",
    METADATA,
    Column("id", Text, primary_key=True),
    Column("started", Double, nullable=False),
    Column("seen", Double, nullable=False),
    #: Jobs of agents that it works on at a time; 0 for a server that leaves them to others.
    Column("capacity", Integer, nullable=False, server_default="0"),
)

#: Keys that callers show; of the secret part only a digest is kept.
api_keys = Table(
    "api_keys",
    METADATA,
    Column("id", Text, primary_key=True),
    *texts("tenant", "name", "digest", "scope"),
    Column("created", Double, nullable=False),
    Column("expires", Double),
    Column("revoked", Double),
    Column("rate", Integer),
    Column("job_limit", Integer),
    Column("storage_limit", BigInteger),
)

#: Changes of robots, scenes and keys: who made them, and when.
audit = Table(
    "audit",
    METADATA,
    Column("id", Integer, primary_key=True, autoincrement=True),
    Column("time", Double, nullable=False),
    *texts("tenant"),
    Column("api_key", Text),
    *texts("action", "target"),
)


def superfluous(
    table: Table, time: ColumnElement[Any], size: ColumnElement[Any], count: int, storage: int,
    of: ColumnElement[bool] = _EVERY,
) -> Select[tuple[Any]]:  # fmt: skip
    """Ids of the oldest rows of tenants that have too many, or too large ones.

    Args:
        table: Table with the columns id and tenant.
        time: Column that tells how old a row is.
        size: Size of a row [byte].
        count: Rows that each tenant may keep.
        storage: Size that these may have together [byte].
        of: Rows that count.
    """
    window: dict[str, Any] = {
        "partition_by": table.c.tenant, "order_by": (time.desc(), table.c.id.desc())
    }  # fmt: skip
    rank = func.row_number().over(**window).label("rank")
    total = func.sum(size).over(**window).label("total")
    ranked = select(table.c.id, rank, total).where(of).subquery()
    # The newest one stays, however large it is: somebody is about to ask for it.
    return select(ranked.c.id).where(
        (ranked.c.rank > count) | ((ranked.c.total > storage) & (ranked.c.rank > 1))
    )
