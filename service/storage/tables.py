"""Tables of the database, for SQLite and PostgreSQL alike, and the migrations that lead to them.

Migrations, and the columns that they share with the tables, never change: every database of before
is led to this version by them. Later columns are added beside these.
"""

from collections.abc import Callable
from typing import Any

from alembic.migration import MigrationContext
from alembic.operations import Operations
from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    ColumnElement,
    Connection,
    Double,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    PrimaryKeyConstraint,
    Select,
    String,
    Table,
    Text,
    false,
    func,
    select,
    text,
    true,
)
from sqlalchemy.schema import SchemaItem

METADATA = MetaData()
_EVERY = true()
#: Whose robots, scenes and jobs those are that came without an API key.
DEFAULT_TENANT = "default"
#: Text that sorts by code points in every database, as Python sorts it.
SORTED_TEXT = Text().with_variant(Text(collation="C"), "postgresql")


def texts(*names: str) -> list[Column[str]]:
    """Columns of texts that are never absent."""
    return [Column(name, Text, nullable=False) for name in names]


def _documents() -> list[Column[Any]]:
    return [
        *texts("kind"),
        Column("name", SORTED_TEXT, nullable=False),
        Column("content", LargeBinary, nullable=False),
        *texts("hash"),
        Column("version", Integer, nullable=False),
        Column("created", Double, nullable=False),
        Column("updated", Double, nullable=False),
    ]


def _answers() -> list[Column[Any]]:
    return [
        *texts("key", "endpoint", "request_hash"),
        Column("status", Integer),
        Column("headers", Text),
        Column("body", LargeBinary),
        Column("created", Double, nullable=False),
    ]


def _jobs() -> list[Column[Any]]:
    return [
        Column("id", SORTED_TEXT, primary_key=True),
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
    ]


def _plans() -> list[Column[Any]]:
    return [
        Column("id", SORTED_TEXT, primary_key=True),
        *texts("tenant"),
        Column("api_key", Text),
        *texts("method", "path"),
        Column("request", LargeBinary, nullable=False),
        Column("status", Integer, nullable=False),
        Column("code", Text),
        Column("answer", LargeBinary, nullable=False),
        *(Column(name, Text) for name in ("robot", "robot_hash", "scene", "scene_hash")),
        Column("seed", BigInteger),
        *texts("version", "digest"),
        Column("created", Double, nullable=False),
        Column("job", Text),
        Column("replay_of", Text),
    ]


def _plan_documents() -> list[SchemaItem]:
    return [
        *texts("tenant", "hash"),
        Column("content", LargeBinary, nullable=False),
        PrimaryKeyConstraint("tenant", "hash"),
    ]


def _servers() -> list[Column[Any]]:
    return [
        Column("id", Text, primary_key=True),
        Column("started", Double, nullable=False),
        Column("seen", Double, nullable=False),
    ]


def _api_keys() -> list[Column[Any]]:
    return [
        Column("id", Text, primary_key=True),
        *texts("tenant", "name", "digest", "scope"),
        Column("created", Double, nullable=False),
        Column("expires", Double),
        Column("revoked", Double),
        Column("rate", Integer),
        Column("job_limit", Integer),
        Column("storage_limit", BigInteger),
    ]


def _audit() -> list[Column[Any]]:
    return [
        Column("id", Integer, primary_key=True, autoincrement=True),
        Column("time", Double, nullable=False),
        *texts("tenant"),
        Column("api_key", Text),
        *texts("action", "target"),
    ]


def _tenant() -> Column[str]:
    return Column("tenant", Text, nullable=False, server_default=DEFAULT_TENANT)


def _capacity() -> Column[int]:
    """Jobs of agents that a server works on at a time; 0 where it leaves them to others."""
    return Column("capacity", Integer, nullable=False, server_default="0")


def _attempt() -> Column[int]:
    return Column("attempt", Integer, nullable=False, server_default="1")


def _agent_columns() -> list[Column[Any]]:
    return [
        #: "agents" if a queue carries it to agents; servers that accepted it run it otherwise.
        Column("carrier", Text),
        #: Of a chunk: the batch that it is a part of, and the index of its first problem there.
        Column("parent", SORTED_TEXT),
        Column("first", Integer),
        #: Problems of a chunk, or of a batch that was cut into chunks.
        Column("size", Integer),
    ]


def _proved() -> Column[bool]:
    return Column("proved_here", Boolean, nullable=False, server_default=false())


#: Robots and scenes.
documents = Table(
    "documents",
    METADATA,
    *texts("tenant"),
    *_documents(),
    PrimaryKeyConstraint("tenant", "kind", "name"),
)

#: Answers of idempotency keys; without a status the first request is still being worked on. Of a
#: claimed key they have the server that works on its request.
answers = Table(
    "answers",
    METADATA,
    *texts("tenant"),
    *_answers(),
    Column("server", Text),
    PrimaryKeyConstraint("tenant", "key", "endpoint"),
)

#: Requests that are answered later, and their answers; with the server that has queued each or
#: works on it, and the key of its caller.
jobs = Table(
    "jobs",
    METADATA,
    *_jobs(),
    _tenant(),
    *(Column(name, Text) for name in ("server", "api_key")),
    _attempt(),
    *_agent_columns(),
)
Index("jobs_by_status", jobs.c.status, jobs.c.ended)
Index("jobs_by_tenant", jobs.c.tenant, jobs.c.id)
Index("jobs_by_parent", jobs.c.parent)

#: Kept requests with their answers or problems, see `plan_store.PlanRecord`.
plans = Table("plans", METADATA, *_plans(), _proved())
Index("plans_by_tenant", plans.c.tenant, plans.c.id)

#: Documents of robots and scenes that kept plans refer to, by content hash.
plan_documents = Table("plan_documents", METADATA, *_plan_documents())

#: Servers that share the database.
servers = Table("servers", METADATA, *_servers(), _capacity())

#: Keys that callers show; of the secret part only a digest is kept.
api_keys = Table("api_keys", METADATA, *_api_keys())

#: Changes of robots, scenes and keys: who made them, and when.
audit = Table("audit", METADATA, *_audit())


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


def upgrade(connection: Connection, present: str | None) -> None:
    """Lead a database to the revision of this version.

    Args:
        connection: Connection in a transaction.
        present: Revision that the database has; None before its first migration.
    """
    operations = Operations(MigrationContext.configure(connection))
    operations.create_table(
        "alembic_version",
        Column("version_num", String(32), nullable=False),
        PrimaryKeyConstraint("version_num", name="alembic_version_pkc"),
        if_not_exists=True,
    )
    for revision in REVISIONS[0 if present is None else REVISIONS.index(present) + 1 :]:
        MIGRATIONS[revision](operations)
    connection.execute(text("DELETE FROM alembic_version"))
    version = text("INSERT INTO alembic_version (version_num) VALUES (:revision)")
    connection.execute(version, {"revision": REVISIONS[-1]})


#: First tables whose rows belong to a tenant since 0002: their columns, and their keys before it.
_OWNED = {"documents": (_documents, ("kind", "name")), "answers": (_answers, ("key", "endpoint"))}


def _first_tables(op: Operations) -> None:
    """Documents, answers of idempotency keys, and jobs.

    A SQLite file of before the migrations has these tables already.
    """
    for table, (columns, key) in _OWNED.items():
        op.create_table(table, *columns(), PrimaryKeyConstraint(*key), if_not_exists=True)
    op.create_table("jobs", *_jobs(), if_not_exists=True)
    op.create_index("jobs_by_status", "jobs", ["status", "ended"], if_not_exists=True)


def _tenants(op: Operations) -> None:
    """Tenants: robots, scenes, jobs and answers belong to one each; those there are, to default."""
    for table, (columns, key) in _OWNED.items():
        if op.get_bind().dialect.name == "sqlite":
            # SQLite can't change a primary key.
            op.rename_table(table, f"old_{table}")
            key_of_tenant = PrimaryKeyConstraint("tenant", *key)
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


def _sharing(op: Operations) -> None:
    """Servers that share a database, and which of them works on a job or a claimed key."""
    op.create_table("servers", *_servers())
    for table in ("answers", "jobs"):
        op.add_column(table, Column("server", Text))


def _keys(op: Operations) -> None:
    """API keys, the audit log, and which key made a job."""
    op.create_table("api_keys", *_api_keys())
    op.create_table("audit", *_audit())
    op.add_column("jobs", Column("api_key", Text))


def _attempts(op: Operations) -> None:
    """Attempts of jobs: a count of the servers that have had each in work."""
    op.add_column("jobs", _attempt())


def _kept(op: Operations) -> None:
    """Kept plans, and the robots and scenes that they were about."""
    op.create_table("plans", *_plans())
    op.create_index("plans_by_tenant", "plans", ["tenant", "id"])
    op.create_table("plan_documents", *_plan_documents())


def _agents(op: Operations) -> None:
    """Jobs that agents work on, and chunks of batches."""
    for column in _agent_columns():
        op.add_column("jobs", column)
    op.create_index("jobs_by_parent", "jobs", ["parent"])
    op.add_column("servers", _capacity())


def _proofs(op: Operations) -> None:
    """Whether a plan was proved here: of those from before nobody knows, so they were not."""
    op.add_column("plans", _proved())


#: Migrations by the revision that each leads to, the oldest first.
MIGRATIONS: dict[str, Callable[[Operations], None]] = {
    f"{number:04}": lead
    for number, lead in enumerate(
        (_first_tables, _tenants, _sharing, _keys, _attempts, _kept, _agents, _proofs), start=1
    )
}
#: Revisions of the schema, the oldest first.
REVISIONS = tuple(MIGRATIONS)
