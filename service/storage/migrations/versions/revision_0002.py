"""Tenants: robots, scenes, jobs and answers belong to one each; those there are, to the default."""

import sqlalchemy as sa
from alembic import op

from service.storage.tables import DEFAULT_TENANT, SORTED_TEXT

revision = "0002"
down_revision = "0001"

#: Tables whose primary key begins with the tenant, and the rest of that key.
_KEYS = {"documents": ("kind", "name"), "answers": ("key", "endpoint")}


def upgrade() -> None:
    """Add the column `tenant`."""
    if op.get_bind().dialect.name == "sqlite":
        _copy_tables()
    else:
        for table, key in _KEYS.items():
            op.add_column(table, _tenant())
            op.drop_constraint(f"{table}_pkey", table, type_="primary")
            op.create_primary_key(f"{table}_pkey", table, ["tenant", *key])
            op.alter_column(table, "tenant", server_default=None)
    op.add_column("jobs", _tenant())
    op.create_index("jobs_by_tenant", "jobs", ["tenant", "id"])


def _copy_tables() -> None:
    """Copy the tables, since SQLite can't change a primary key."""
    for table in _KEYS:
        op.rename_table(table, f"old_{table}")
    op.create_table(
        "documents",
        sa.Column("tenant", sa.Text, nullable=False),
        sa.Column("kind", sa.Text, nullable=False),
        sa.Column("name", SORTED_TEXT, nullable=False),
        sa.Column("content", sa.LargeBinary, nullable=False),
        sa.Column("hash", sa.Text, nullable=False),
        sa.Column("version", sa.Integer, nullable=False),
        sa.Column("created", sa.Double, nullable=False),
        sa.Column("updated", sa.Double, nullable=False),
        sa.PrimaryKeyConstraint("tenant", "kind", "name"),
    )
    op.create_table(
        "answers",
        sa.Column("tenant", sa.Text, nullable=False),
        sa.Column("key", sa.Text, nullable=False),
        sa.Column("endpoint", sa.Text, nullable=False),
        sa.Column("request_hash", sa.Text, nullable=False),
        sa.Column("status", sa.Integer),
        sa.Column("headers", sa.Text),
        sa.Column("body", sa.LargeBinary),
        sa.Column("created", sa.Double, nullable=False),
        sa.PrimaryKeyConstraint("tenant", "key", "endpoint"),
    )
    for table in _KEYS:
        columns = [column["name"] for column in sa.inspect(op.get_bind()).get_columns(table)]
        names = ", ".join(name for name in columns if name != "tenant")
        op.execute(
            f"INSERT INTO {table} (tenant, {names}) "  # nosec B608
            f"SELECT '{DEFAULT_TENANT}', {names} FROM old_{table}"
        )
        op.drop_table(f"old_{table}")


def _tenant() -> sa.Column[str]:
    return sa.Column("tenant", sa.Text, nullable=False, server_default=DEFAULT_TENANT)
