"""Kept plans whose answers were proved here."""

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"


def upgrade() -> None:
    """Add whether a plan was proved here: of those from before nobody knows, so they were not."""
    proved = sa.Column("proved_here", sa.Boolean, nullable=False, server_default=sa.false())
    op.add_column("plans", proved)
