"""Roll-outs, what they give each robot, and the names of robots that speak VDA 5050."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None

_JSON = sa.JSON().with_variant(postgresql.JSONB(astext_type=sa.Text()), "postgresql")
_MOMENT = sa.DateTime(timezone=True)
_STATES = "state IN ('running', 'paused', 'stopped', 'aborted', 'finished')"
_KINDS = "kind IN ('stage', 'paused', 'resumed', 'stopped', 'aborted', 'finished')"
_ROBOT_INDEXES = (
    ("ix_robots_map_id_channel_assigned_n", ["map_id", "channel", "assigned_n"], False),
    ("ix_robots_manufacturer_serial_number", ["manufacturer", "serial_number"], True),
)


def upgrade() -> None:
    with op.batch_alter_table("robots") as table:
        table.add_column(sa.Column("assigned_n", sa.Integer(), nullable=True))
        table.add_column(sa.Column("manufacturer", sa.String(length=100), nullable=True))
        table.add_column(sa.Column("serial_number", sa.String(length=100), nullable=True))
    for name, columns, unique in _ROBOT_INDEXES:
        op.create_index(op.f(name), "robots", columns, unique=unique)
    _rollouts()


def _rollouts() -> None:
    op.create_table(
        "rollouts",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("map_id", sa.String(length=40), nullable=False),
        sa.Column("channel", sa.String(length=40), nullable=False),
        sa.Column("revision_n", sa.Integer(), nullable=False),
        sa.Column("from_n", sa.Integer(), nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("stages", _JSON, nullable=False),
        sa.Column("stage", sa.Integer(), nullable=False),
        sa.Column("stage_began_at", _MOMENT, nullable=False),
        sa.Column("bound", sa.String(length=16), nullable=True),
        sa.Column("failure_limit", sa.Integer(), nullable=False),
        sa.Column("counts_from", _MOMENT, nullable=False),
        sa.Column("reason", sa.Text(), nullable=True),
        sa.Column("override", sa.Text(), nullable=True),
        sa.Column("overridden", _JSON, nullable=True),
        sa.Column("created_at", _MOMENT, nullable=False),
        sa.Column("created_by", sa.String(length=40), nullable=False),
        sa.Column("ended_at", _MOMENT, nullable=True),
        sa.CheckConstraint(_STATES, name=op.f("ck_rollouts_state")),
        sa.ForeignKeyConstraint(["map_id"], ["maps.id"], name=op.f("fk_rollouts_map_id")),
        sa.ForeignKeyConstraint(["created_by"], ["keys.id"], name=op.f("fk_rollouts_created_by")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_rollouts")),
    )
    op.create_index(op.f("ix_rollouts_map_id_channel_state"), "rollouts", ["map_id", "channel", "state"])
    op.create_index(op.f("ix_rollouts_map_id_id"), "rollouts", ["map_id", "id"])
    op.create_index(op.f("ix_rollouts_state_id"), "rollouts", ["state", "id"])
    op.create_table(
        "rollout_steps",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("rollout_id", sa.String(length=40), nullable=False),
        sa.Column("map_id", sa.String(length=40), nullable=False),
        sa.Column("kind", sa.String(length=16), nullable=False),
        sa.Column("stage", sa.Integer(), nullable=False),
        sa.Column("detail", sa.Text(), nullable=True),
        sa.Column("at", _MOMENT, nullable=False),
        sa.Column("key_id", sa.String(length=40), nullable=True),
        sa.CheckConstraint(_KINDS, name=op.f("ck_rollout_steps_kind")),
        sa.ForeignKeyConstraint(["rollout_id"], ["rollouts.id"], name=op.f("fk_rollout_steps_rollout_id")),
        sa.ForeignKeyConstraint(["map_id"], ["maps.id"], name=op.f("fk_rollout_steps_map_id")),
        sa.ForeignKeyConstraint(["key_id"], ["keys.id"], name=op.f("fk_rollout_steps_key_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_rollout_steps")),
    )
    op.create_index(op.f("ix_rollout_steps_rollout_id_id"), "rollout_steps", ["rollout_id", "id"])


def downgrade() -> None:
    op.drop_index(op.f("ix_rollout_steps_rollout_id_id"), table_name="rollout_steps")
    op.drop_table("rollout_steps")
    op.drop_index(op.f("ix_rollouts_state_id"), table_name="rollouts")
    op.drop_index(op.f("ix_rollouts_map_id_id"), table_name="rollouts")
    op.drop_index(op.f("ix_rollouts_map_id_channel_state"), table_name="rollouts")
    op.drop_table("rollouts")
    for name, _, _ in _ROBOT_INDEXES:
        op.drop_index(op.f(name), table_name="robots")
    with op.batch_alter_table("robots") as table:
        for column in ("serial_number", "manufacturer", "assigned_n"):
            table.drop_column(column)
