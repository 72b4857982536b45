"""The pixels of a drawing's sheet are kept in tiles, for viewers."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0013"
down_revision = "0012"
branch_labels = None
depends_on = None

_COLUMNS = ("sheet_sha256", "tiles_sha256")


def upgrade() -> None:
    with op.batch_alter_table("drawings") as table:
        for name in _COLUMNS:
            table.add_column(sa.Column(name, sa.String(length=64), nullable=True))
            table.create_foreign_key(op.f(f"fk_drawings_{name}"), "blobs", [name], ["sha256"])


def downgrade() -> None:
    with op.batch_alter_table("drawings") as table:
        for name in _COLUMNS:
            table.drop_constraint(op.f(f"fk_drawings_{name}"), type_="foreignkey")
            table.drop_column(name)
