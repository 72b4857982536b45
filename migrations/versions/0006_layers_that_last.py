"""Layers with a name that lasts, erased regions, why and by what a revision was made, audit, comparisons."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None

_JSON = sa.JSON().with_variant(postgresql.JSONB(astext_type=sa.Text()), "postgresql")
_AUDIT_INDEXES = (["map_id", "id"], ["key_id", "id"], ["action", "id"], ["subject_id", "id"])


def upgrade() -> None:
    _layers()
    _revisions()
    with op.batch_alter_table("publications") as table:
        table.add_column(sa.Column("reason", sa.Text(), nullable=True))
        table.add_column(sa.Column("overridden", _JSON, nullable=True))
    _audit()
    _comparisons()
    _proposals()
    op.create_index(op.f("ix_jobs_state_id"), "jobs", ["state", "id"])
    op.create_index(op.f("ix_jobs_kind_id"), "jobs", ["kind", "id"])
    op.create_index(op.f("ix_revisions_map_id_status_n"), "revisions", ["map_id", "status", "n"])


def _layers() -> None:
    with op.batch_alter_table("layers") as table:
        table.add_column(sa.Column("layer_id", sa.String(length=40), nullable=True))
        table.add_column(sa.Column("visible", sa.Boolean(), nullable=False, server_default=sa.true()))
        table.add_column(sa.Column("t_map_scan", _JSON, nullable=True))
    op.execute("UPDATE layers SET layer_id = id")
    with op.batch_alter_table("layers") as table:
        table.alter_column("layer_id", existing_type=sa.String(length=40), nullable=False)
        table.create_unique_constraint(op.f("uq_layers_revision_id_layer_id"), ["revision_id", "layer_id"])


def _revisions() -> None:
    with op.batch_alter_table("revisions") as table:
        table.add_column(sa.Column("base_n", sa.Integer(), nullable=True))
        table.add_column(sa.Column("operations", _JSON, nullable=True))
        table.add_column(sa.Column("erased", _JSON, nullable=True))
        table.add_column(sa.Column("reason", sa.Text(), nullable=True))
        table.add_column(sa.Column("software_version", sa.String(length=40), nullable=True))
        table.add_column(sa.Column("artifacts_sha256", sa.String(length=64), nullable=True))
        table.add_column(sa.Column("pruned_at", sa.DateTime(timezone=True), nullable=True))


def _audit() -> None:
    op.create_table(
        "audit",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("key_id", sa.String(length=40), nullable=True),
        sa.Column("action", sa.String(length=40), nullable=False),
        sa.Column("map_id", sa.String(length=40), nullable=True),
        sa.Column("subject_id", sa.String(length=40), nullable=False),
        sa.Column("before", _JSON, nullable=True),
        sa.Column("after", _JSON, nullable=True),
        sa.ForeignKeyConstraint(["key_id"], ["keys.id"], name=op.f("fk_audit_key_id")),
        sa.ForeignKeyConstraint(["map_id"], ["maps.id"], name=op.f("fk_audit_map_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_audit")),
    )
    for columns in _AUDIT_INDEXES:
        op.create_index(op.f(f"ix_audit_{'_'.join(columns)}"), "audit", columns)


def _comparisons() -> None:
    op.create_table(
        "comparisons",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("from_revision_id", sa.String(length=40), nullable=False),
        sa.Column("to_revision_id", sa.String(length=40), nullable=False),
        sa.Column("job_id", sa.String(length=40), nullable=False),
        sa.Column("geometry", _JSON, nullable=True),
        sa.Column("picture_sha256", sa.String(length=64), nullable=True),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(
            ["from_revision_id"], ["revisions.id"], name=op.f("fk_comparisons_from_revision_id")
        ),
        sa.ForeignKeyConstraint(
            ["to_revision_id"], ["revisions.id"], name=op.f("fk_comparisons_to_revision_id")
        ),
        sa.ForeignKeyConstraint(["job_id"], ["jobs.id"], name=op.f("fk_comparisons_job_id")),
        sa.ForeignKeyConstraint(
            ["picture_sha256"], ["blobs.sha256"], name=op.f("fk_comparisons_picture_sha256")
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_comparisons")),
        sa.UniqueConstraint(
            "from_revision_id",
            "to_revision_id",
            name=op.f("uq_comparisons_from_revision_id_to_revision_id"),
        ),
        sa.UniqueConstraint("job_id", name=op.f("uq_comparisons_job_id")),
    )


def _proposals() -> None:
    op.create_table(
        "proposals",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("map_id", sa.String(length=40), nullable=False),
        sa.Column("placement_id", sa.String(length=40), nullable=False),
        sa.Column("layer_id", sa.String(length=40), nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("evidence", _JSON, nullable=False),
        sa.Column("revision_n", sa.Integer(), nullable=True),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("decided_at", sa.DateTime(timezone=True), nullable=True),
        sa.Column("decided_by", sa.String(length=40), nullable=True),
        sa.CheckConstraint("state IN ('open', 'accepted', 'dismissed')", name=op.f("ck_proposals_state")),
        sa.ForeignKeyConstraint(["map_id"], ["maps.id"], name=op.f("fk_proposals_map_id")),
        sa.ForeignKeyConstraint(["placement_id"], ["placements.id"], name=op.f("fk_proposals_placement_id")),
        sa.ForeignKeyConstraint(["decided_by"], ["keys.id"], name=op.f("fk_proposals_decided_by")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_proposals")),
        sa.UniqueConstraint("placement_id", "layer_id", name=op.f("uq_proposals_placement_id_layer_id")),
    )
    op.create_index(op.f("ix_proposals_map_id_state_id"), "proposals", ["map_id", "state", "id"])


def downgrade() -> None:
    op.drop_index(op.f("ix_revisions_map_id_status_n"), table_name="revisions")
    op.drop_index(op.f("ix_jobs_kind_id"), table_name="jobs")
    op.drop_index(op.f("ix_jobs_state_id"), table_name="jobs")
    op.drop_index(op.f("ix_proposals_map_id_state_id"), table_name="proposals")
    op.drop_table("proposals")
    op.drop_table("comparisons")
    for columns in _AUDIT_INDEXES:
        op.drop_index(op.f(f"ix_audit_{'_'.join(columns)}"), table_name="audit")
    op.drop_table("audit")
    with op.batch_alter_table("publications") as table:
        table.drop_column("overridden")
        table.drop_column("reason")
    names = ("pruned_at", "artifacts_sha256", "software_version", "reason", "erased", "operations", "base_n")
    with op.batch_alter_table("revisions") as table:
        for name in names:
            table.drop_column(name)
    with op.batch_alter_table("layers") as table:
        table.drop_constraint(op.f("uq_layers_revision_id_layer_id"), type_="unique")
        for name in ("t_map_scan", "visible", "layer_id"):
            table.drop_column(name)
