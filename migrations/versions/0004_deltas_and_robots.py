"""Deltas between clouds, robots and their reports."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

_STATES = "state IN ('downloaded', 'verified', 'enabled', 'failed')"


def upgrade() -> None:
    op.create_table(
        "deltas",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("from_sha256", sa.String(length=64), nullable=False),
        sa.Column("to_sha256", sa.String(length=64), nullable=False),
        sa.Column("job_id", sa.String(length=40), nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=True),
        sa.Column("size_bytes", sa.BigInteger(), nullable=True),
        sa.Column("coded_sha256", sa.String(length=64), nullable=True),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(["job_id"], ["jobs.id"], name=op.f("fk_deltas_job_id")),
        sa.ForeignKeyConstraint(["sha256"], ["blobs.sha256"], name=op.f("fk_deltas_sha256")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_deltas")),
        sa.UniqueConstraint("from_sha256", "to_sha256", name=op.f("uq_deltas_from_sha256_to_sha256")),
        sa.UniqueConstraint("job_id", name=op.f("uq_deltas_job_id")),
    )
    op.create_table(
        "robots",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("name", sa.String(length=200), nullable=False),
        sa.Column("map_id", sa.String(length=40), nullable=False),
        sa.Column("channel", sa.String(length=40), nullable=False),
        sa.Column("group_name", sa.String(length=40), nullable=True),
        sa.Column("key_id", sa.String(length=40), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("enabled_n", sa.Integer(), nullable=True),
        sa.Column("state", sa.String(length=16), nullable=True),
        sa.Column("reported_n", sa.Integer(), nullable=True),
        sa.Column("reported_at", sa.DateTime(timezone=True), nullable=True),
        sa.Column("detail", sa.Text(), nullable=True),
        sa.CheckConstraint(_STATES, name=op.f("ck_robots_state")),
        sa.ForeignKeyConstraint(["key_id"], ["keys.id"], name=op.f("fk_robots_key_id")),
        sa.ForeignKeyConstraint(["map_id"], ["maps.id"], name=op.f("fk_robots_map_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_robots")),
        sa.UniqueConstraint("key_id", name=op.f("uq_robots_key_id")),
    )
    op.create_index(op.f("ix_robots_map_id_id"), "robots", ["map_id", "id"])
    op.create_table(
        "robot_reports",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("robot_id", sa.String(length=40), nullable=False),
        sa.Column("revision_n", sa.Integer(), nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=True),
        sa.Column("detail", sa.Text(), nullable=True),
        sa.Column("at", sa.DateTime(timezone=True), nullable=False),
        sa.CheckConstraint(_STATES, name=op.f("ck_robot_reports_state")),
        sa.ForeignKeyConstraint(["robot_id"], ["robots.id"], name=op.f("fk_robot_reports_robot_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_robot_reports")),
    )
    op.create_index(op.f("ix_robot_reports_robot_id_id"), "robot_reports", ["robot_id", "id"])


def downgrade() -> None:
    op.drop_index(op.f("ix_robot_reports_robot_id_id"), table_name="robot_reports")
    op.drop_table("robot_reports")
    op.drop_index(op.f("ix_robots_map_id_id"), table_name="robots")
    op.drop_table("robots")
    op.drop_table("deltas")
