"""Migrations of the schema: each leads from the revision before it to its own.

What stands here never changes, as every database of before is led to this version by it.

Tables of the database, for SQLite and PostgreSQL alike.
"""

from collections.abc import Callable
from typing import Any

import sqlalchemy as sa
from alembic.migration import MigrationContext
from alembic.operations import Operations
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


def upgrade(connection: sa.Connection, present: str | None) -> None:
    """Lead a database to the revision of this version.

    Args:
        connection: Connection in a transaction.
        present: Revision that the database has; None before its first migration.
    """
    operations = Operations(MigrationContext.configure(connection))
    operations.create_table(
        "alembic_version",
        sa.Column("version_num", sa.String(32), nullable=False),
        sa.PrimaryKeyConstraint("version_num", name="alembic_version_pkc"),
        if_not_exists=True,
    )
    for revision in REVISIONS[0 if present is None else REVISIONS.index(present) + 1 :]:
        MIGRATIONS[revision](operations)
    connection.execute(sa.text("DELETE FROM alembic_version"))
    version = sa.text("INSERT INTO alembic_version (version_num) VALUES (:revision)")
    connection.execute(version, {"revision": REVISIONS[-1]})


def _documents() -> list[sa.Column[Any]]:
    return [
        *texts("kind"),
        sa.Column("name", SORTED_TEXT, nullable=False),
        sa.Column("content", sa.LargeBinary, nullable=False),
        *texts("hash"),
        sa.Column("version", sa.Integer, nullable=False),
        sa.Column("created", sa.Double, nullable=False),
        sa.Column("updated", sa.Double, nullable=False),
    ]


def _answers() -> list[sa.Column[Any]]:
    return [
        *texts("key", "endpoint", "request_hash"),
        sa.Column("status", sa.Integer),
        sa.Column("headers", sa.Text),
        sa.Column("body", sa.LargeBinary),
        sa.Column("created", sa.Double, nullable=False),
    ]


#: First tables whose rows belong to a tenant since 0002: their columns, and their keys before it.
_OWNED = {"documents": (_documents, ("kind", "name")), "answers": (_answers, ("key", "endpoint"))}


def _first_tables(op: Operations) -> None:
    """Documents, answers of idempotency keys, and jobs.

    A SQLite file of before the migrations has these tables already.
    """
    for table, (columns, key) in _OWNED.items():
        op.create_table(table, *columns(), sa.PrimaryKeyConstraint(*key), if_not_exists=True)
    op.create_table(
        "jobs",
        sa.Column("id", SORTED_TEXT, primary_key=True),
        *texts("method", "path", "content_type"),
        sa.Column("request", sa.LargeBinary),
        *texts("status"),
        sa.Column("progress", sa.Double, nullable=False),
        sa.Column("stage", sa.Text),
        sa.Column("event", sa.Integer, nullable=False),
        sa.Column("created", sa.Double, nullable=False),
        sa.Column("started", sa.Double),
        sa.Column("ended", sa.Double),
        sa.Column("location", sa.Text),
        sa.Column("answer_type", sa.Text),
        sa.Column("answer", sa.LargeBinary),
        if_not_exists=True,
    )
    op.create_index("jobs_by_status", "jobs", ["status", "ended"], if_not_exists=True)


def _tenants(op: Operations) -> None:
    """Tenants: robots, scenes, jobs and answers belong to one each; those there are, to default."""
    for table, (columns, key) in _OWNED.items():
        if op.get_bind().dialect.name == "sqlite":
            # SQLite can't change a primary key.
            op.rename_table(table, f"old_{table}")
            key_of_tenant = sa.PrimaryKeyConstraint("tenant", *key)
            op.create_table(table, *texts("tenant"), *columns(), key_of_tenant)
            names = ", ".join(column.name for column in columns())
            op.execute(
                f"INSERT INTO {table} (tenant, {names}) "  # nosec B608
                f"SELECT '{DEFAULT_TENANT}', {names} FROM old_{table}"
            )
            op.drop_table(f"old_{table}")
        else:
            op.add_column(table, _tenant())
            op.drop_constraint(f"{table}_pkey", table, type_="primary")
            op.create_primary_key(f"{table}_pkey", table, ["tenant", *key])
            op.alter_column(table, "tenant", server_default=None)
    op.add_column("jobs", _tenant())
    op.create_index("jobs_by_tenant", "jobs", ["tenant", "id"])


def _tenant() -> sa.Column[str]:
    return sa.Column("tenant", sa.Text, nullable=False, server_default=DEFAULT_TENANT)


def _servers(op: Operations) -> None:
    """Servers that share a database, and which of them works on a job or a claimed key."""
    op.create_table(
        "servers",
        sa.Column("id", sa.Text, primary_key=True),
        sa.Column("started", sa.Double, nullable=False),
        sa.Column("seen", sa.Double, nullable=False),
    )
    for table in ("answers", "jobs"):
        op.add_column(table, sa.Column("server", sa.Text))


def _keys(op: Operations) -> None:
    """API keys, the audit log, and which key made a job."""
    op.create_table(
        "api_keys",
        sa.Column("id", sa.Text, primary_key=True),
        *texts("tenant", "name", "digest", "scope"),
        sa.Column("created", sa.Double, nullable=False),
        sa.Column("expires", sa.Double),
        sa.Column("revoked", sa.Double),
        sa.Column("rate", sa.Integer),
        sa.Column("job_limit", sa.Integer),
        sa.Column("storage_limit", sa.BigInteger),
    )
    op.create_table(
        "audit",
        sa.Column("id", sa.Integer, primary_key=True, autoincrement=True),
        sa.Column("time", sa.Double, nullable=False),
        *texts("tenant"),
        sa.Column("api_key", sa.Text),
        *texts("action", "target"),
    )
    op.add_column("jobs", sa.Column("api_key", sa.Text))


def _attempts(op: Operations) -> None:
    """Attempts of jobs: a count of the servers that have had each in work."""
    op.add_column("jobs", sa.Column("attempt", sa.Integer, nullable=False, server_default="1"))


def _plans(op: Operations) -> None:
    """Kept plans, and the robots and scenes that they were about."""
    op.create_table(
        "plans",
        sa.Column("id", SORTED_TEXT, primary_key=True),
        *texts("tenant"),
        sa.Column("api_key", sa.Text),
        *texts("method", "path"),
        sa.Column("request", sa.LargeBinary, nullable=False),
        sa.Column("status", sa.Integer, nullable=False),
        sa.Column("code", sa.Text),
        sa.Column("answer", sa.LargeBinary, nullable=False),
        *(sa.Column(name, sa.Text) for name in ("robot", "robot_hash", "scene", "scene_hash")),
        sa.Column("seed", sa.BigInteger),
        *texts("version", "digest"),
        sa.Column("created", sa.Double, nullable=False),
        sa.Column("job", sa.Text),
        sa.Column("replay_of", sa.Text),
    )
    op.create_index("plans_by_tenant", "plans", ["tenant", "id"])
    op.create_table(
        "plan_documents",
        *texts("tenant", "hash"),
        sa.Column("content", sa.LargeBinary, nullable=False),
        sa.PrimaryKeyConstraint("tenant", "hash"),
    )


def _agents(op: Operations) -> None:
    """Jobs that agents work on, and chunks of batches."""
    op.add_column("jobs", sa.Column("carrier", sa.Text))
    op.add_column("jobs", sa.Column("parent", SORTED_TEXT))
    op.add_column("jobs", sa.Column("first", sa.Integer))
    op.add_column("jobs", sa.Column("size", sa.Integer))
    op.create_index("jobs_by_parent", "jobs", ["parent"])
    capacity = sa.Column("capacity", sa.Integer, nullable=False, server_default="0")
    op.add_column("servers", capacity)


def _proofs(op: Operations) -> None:
    """Whether a plan was proved here: of those from before nobody knows, so they were not."""
    proved = sa.Column("proved_here", sa.Boolean, nullable=False, server_default=sa.false())
    op.add_column("plans", proved)


#: Migrations by the revision that each leads to.
MIGRATIONS: dict[str, Callable[[Operations], None]] = {
    "0001": _first_tables,
    "0002": _tenants,
    "0003": _servers,
    "0004": _keys,
    "0005": _attempts,
    "0006": _plans,
    "0007": _agents,
    "0008": _proofs,
}
