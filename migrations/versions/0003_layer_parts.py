"""Layers hold a part of their scan; where none is written they hold all of it."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

_JSON = sa.JSON().with_variant(postgresql.JSONB(astext_type=sa.Text()), "postgresql")


def upgrade() -> None:
    with op.batch_alter_table("layers") as table:
        table.add_column(sa.Column("part", _JSON, nullable=True))


def downgrade() -> None:
    with op.batch_alter_table("layers") as table:
        table.drop_column("part")
