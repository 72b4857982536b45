"""Indexes for lists over all maps, by who made it, by state, and by verdict."""

from __future__ import annotations

from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None

_INDEXES = {
    "revisions": (["map_id", "id"], ["status", "id"], ["created_by", "id"], ["drawing_id", "id"]),
    "placements": (["verdict", "id"], ["created_by", "id"]),
    "drawings": (["created_by", "id"],),
    "scans": (["created_by", "id"],),
    "jobs": (["map_id", "state", "id"], ["kind", "state", "id"], ["subject_id"]),
}


def upgrade() -> None:
    for table, indexes in _INDEXES.items():
        for columns in indexes:
            op.create_index(op.f(f"ix_{table}_{'_'.join(columns)}"), table, columns)


def downgrade() -> None:
    for table, indexes in _INDEXES.items():
        for columns in indexes:
            op.drop_index(op.f(f"ix_{table}_{'_'.join(columns)}"), table_name=table)
