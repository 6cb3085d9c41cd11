"""Documents, answers of idempotency keys, and jobs.

A SQLite file of before the migrations has these tables already.
"""

import sqlalchemy as sa
from alembic import op

from service.storage.tables import SORTED_TEXT

revision = "0001"
down_revision: str | None = None


def upgrade() -> None:
    """Make the tables."""
    op.create_table(
        "documents",
        sa.Column("kind", sa.Text, nullable=False),
        sa.Column("name", SORTED_TEXT, nullable=False),
        sa.Column("content", sa.LargeBinary, nullable=False),
        sa.Column("hash", sa.Text, nullable=False),
        sa.Column("version", sa.Integer, nullable=False),
        sa.Column("created", sa.Double, nullable=False),
        sa.Column("updated", sa.Double, nullable=False),
        sa.PrimaryKeyConstraint("kind", "name"),
        if_not_exists=True,
    )
    op.create_table(
        "answers",
        sa.Column("key", sa.Text, nullable=False),
        sa.Column("endpoint", sa.Text, nullable=False),
        sa.Column("request_hash", sa.Text, nullable=False),
        sa.Column("status", sa.Integer),
        sa.Column("headers", sa.Text),
        sa.Column("body", sa.LargeBinary),
        sa.Column("created", sa.Double, nullable=False),
        sa.PrimaryKeyConstraint("key", "endpoint"),
        if_not_exists=True,
    )
    op.create_table(
        "jobs",
        sa.Column("id", SORTED_TEXT, primary_key=True),
        sa.Column("method", sa.Text, nullable=False),
        sa.Column("path", sa.Text, nullable=False),
        sa.Column("content_type", sa.Text, nullable=False),
        sa.Column("request", sa.LargeBinary),
        sa.Column("status", sa.Text, nullable=False),
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
