"""Jobs that agents work on, and chunks of batches."""

import sqlalchemy as sa
from alembic import op

from service.storage.tables import SORTED_TEXT

revision = "0007"
down_revision = "0006"


def upgrade() -> None:
    """Add what carries a job, what it is a part of, and the capacities of servers."""
    op.add_column("jobs", sa.Column("carrier", sa.Text))
    op.add_column("jobs", sa.Column("parent", SORTED_TEXT))
    op.add_column("jobs", sa.Column("first", sa.Integer))
    op.add_column("jobs", sa.Column("size", sa.Integer))
    op.create_index("jobs_by_parent", "jobs", ["parent"])
    capacity = sa.Column("capacity", sa.Integer, nullable=False, server_default="0")
    op.add_column("servers", capacity)
