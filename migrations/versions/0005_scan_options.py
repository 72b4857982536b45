"""What is said of a scan's file: its up axis and unit."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None

_JSON = sa.JSON().with_variant(postgresql.JSONB(astext_type=sa.Text()), "postgresql")


def upgrade() -> None:
    with op.batch_alter_table("scans") as table:
        table.add_column(sa.Column("options", _JSON, nullable=True))


def downgrade() -> None:
    with op.batch_alter_table("scans") as table:
        table.drop_column("options")
