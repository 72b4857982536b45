"""A job knows the key that asked for it, so that the queue is fair over keys."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0015"
down_revision = "0014"
branch_labels = None
depends_on = None


def upgrade() -> None:
    with op.batch_alter_table("jobs") as table:
        table.add_column(sa.Column("key_id", sa.String(length=40), nullable=True))
        table.create_foreign_key(op.f("fk_jobs_key_id"), "keys", ["key_id"], ["id"])
        table.create_index(op.f("ix_jobs_started_at"), ["started_at"])


def downgrade() -> None:
    with op.batch_alter_table("jobs") as table:
        table.drop_index(op.f("ix_jobs_started_at"))
        table.drop_constraint(op.f("fk_jobs_key_id"), type_="foreignkey")
        table.drop_column("key_id")
