"""The open proposals of all maps are found by an index."""

from __future__ import annotations

from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_index(op.f("ix_proposals_state_id"), "proposals", ["state", "id"])


def downgrade() -> None:
    op.drop_index(op.f("ix_proposals_state_id"), table_name="proposals")
