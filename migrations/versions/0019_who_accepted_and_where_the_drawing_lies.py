"""A layer keeps who took it in, and when; a revision keeps where its drawing's frame lies in the file."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0019"
down_revision = "0018"
branch_labels = None
depends_on = None

_JSON = sa.JSON().with_variant(postgresql.JSONB(astext_type=sa.Text()), "postgresql")
_REVISIONS = sa.table(
    "revisions",
    sa.column("id", sa.String),
    sa.column("drawing_id", sa.String),
    sa.column("walls_sha256", sa.String),
    sa.column("drawing_frame", _JSON),
)
_DRAWINGS = sa.table(
    "drawings", sa.column("id", sa.String), sa.column("walls_sha256", sa.String), sa.column("reading", _JSON)
)


def upgrade() -> None:
    with op.batch_alter_table("layers") as table:
        table.add_column(sa.Column("accepted_by", sa.String(length=40), nullable=True))
        table.add_column(sa.Column("accepted_at", sa.DateTime(timezone=True), nullable=True))
        table.create_foreign_key(op.f("fk_layers_accepted_by_keys"), "keys", ["accepted_by"], ["id"])
    with op.batch_alter_table("revisions") as table:
        table.add_column(sa.Column("drawing_frame", _JSON, nullable=True))
    _accepted()
    _framed()


def _accepted() -> None:
    """Of a layer's placement whoever made the first revision that holds it."""
    op.execute(
        """
        UPDATE layers SET accepted_by = first.created_by, accepted_at = first.created_at
        FROM (
            SELECT l.id AS id,
                first_value(r.created_by) OVER held AS created_by,
                first_value(r.created_at) OVER held AS created_at
            FROM layers AS l JOIN revisions AS r ON r.id = l.revision_id
            WINDOW held AS (PARTITION BY r.map_id, l.layer_id, l.placement_id ORDER BY r.n)
        ) AS first
        WHERE first.id = layers.id
        """
    )


def _framed() -> None:
    """Of the drawing's reading, where the revision was built on the one that is kept."""
    connection = op.get_bind()
    same = sa.and_(
        _DRAWINGS.c.id == _REVISIONS.c.drawing_id, _DRAWINGS.c.walls_sha256 == _REVISIONS.c.walls_sha256
    )
    kept = sa.select(_REVISIONS.c.id, _DRAWINGS.c.reading).select_from(sa.join(_REVISIONS, _DRAWINGS, same))
    for revision_id, reading in connection.execute(kept).all():
        if isinstance(reading, dict) and reading.get("drawing_origin") is not None:
            frame = {name: reading.get(name) for name in ("drawing_origin", "drawing_top")}
            told = sa.update(_REVISIONS).where(_REVISIONS.c.id == revision_id).values(drawing_frame=frame)
            connection.execute(told)


def downgrade() -> None:
    with op.batch_alter_table("revisions") as table:
        table.drop_column("drawing_frame")
    with op.batch_alter_table("layers") as table:
        table.drop_constraint(op.f("fk_layers_accepted_by_keys"), type_="foreignkey")
        table.drop_column("accepted_at")
        table.drop_column("accepted_by")
