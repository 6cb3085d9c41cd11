"""Attempts of jobs: a count of the servers that have had each in work."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"


def upgrade() -> None:
    """Add the column `jobs.attempt`."""
    op.add_column("jobs", sa.Column("attempt", sa.Integer, nullable=False, server_default="1"))
