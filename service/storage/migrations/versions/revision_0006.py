"""Kept plans, and the robots and scenes that they were about."""

import sqlalchemy as sa
from alembic import op

from service.storage.tables import SORTED_TEXT

revision = "0006"
down_revision = "0005"


def upgrade() -> None:
    """Add the tables `plans` and `plan_documents`."""
    op.create_table(
        "plans",
        sa.Column("id", SORTED_TEXT, primary_key=True),
        sa.Column("tenant", sa.Text, nullable=False),
        sa.Column("api_key", sa.Text),
        sa.Column("method", sa.Text, nullable=False),
        sa.Column("path", sa.Text, nullable=False),
        sa.Column("request", sa.LargeBinary, nullable=False),
        sa.Column("status", sa.Integer, nullable=False),
        sa.Column("code", sa.Text),
        sa.Column("answer", sa.LargeBinary, nullable=False),
        sa.Column("robot", sa.Text),
        sa.Column("robot_hash", sa.Text),
        sa.Column("scene", sa.Text),
        sa.Column("scene_hash", sa.Text),
        sa.Column("seed", sa.BigInteger),
        sa.Column("version", sa.Text, nullable=False),
        sa.Column("digest", sa.Text, nullable=False),
        sa.Column("created", sa.Double, nullable=False),
        sa.Column("job", sa.Text),
        sa.Column("replay_of", sa.Text),
    )
    op.create_index("plans_by_tenant", "plans", ["tenant", "id"])
    op.create_table(
        "plan_documents",
        sa.Column("tenant", sa.Text, nullable=False),
        sa.Column("hash", sa.Text, nullable=False),
        sa.Column("content", sa.LargeBinary, nullable=False),
        sa.PrimaryKeyConstraint("tenant", "hash"),
    )
