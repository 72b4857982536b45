"""What a scan's job has read is kept whole, for placements and builds."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None

_KEY = "fk_scans_upright_sha256"


def upgrade() -> None:
    with op.batch_alter_table("scans") as table:
        table.add_column(sa.Column("upright_sha256", sa.String(length=64), nullable=True))
        table.create_foreign_key(op.f(_KEY), "blobs", ["upright_sha256"], ["sha256"])


def downgrade() -> None:
    with op.batch_alter_table("scans") as table:
        table.drop_constraint(op.f(_KEY), type_="foreignkey")
        table.drop_column("upright_sha256")
