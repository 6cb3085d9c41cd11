"""Servers that share a database, and which of them works on a job or a claimed key."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"


def upgrade() -> None:
    """Add the table `servers` and the columns that point to it."""
    op.create_table(
        "servers",
        sa.Column("id", sa.Text, primary_key=True),
        sa.Column("started", sa.Double, nullable=False),
        sa.Column("seen", sa.Double, nullable=False),
    )
    op.add_column("answers", sa.Column("server", sa.Text))
    op.add_column("jobs", sa.Column("server", sa.Text))
