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
    read = sa.select(_DRAWINGS.c.id).where(_DRAWINGS.c.walls_sha256.is_not(None))
    for drawing_id in connection.execute(read).scalars().all():
        one = sa.select(_DRAWINGS.c.walls_sha256, _DRAWINGS.c.reading).where(_DRAWINGS.c.id == drawing_id)
        walls, reading = connection.execute(one).one()
        if _tells_its_frame(reading):
            frame = {name: reading[name] for name in ("drawing_origin", "drawing_top")}
            built_on_it = sa.and_(_REVISIONS.c.drawing_id == drawing_id, _REVISIONS.c.walls_sha256 == walls)
            connection.execute(sa.update(_REVISIONS).where(built_on_it).values(drawing_frame=frame))


def _tells_its_frame(reading: object) -> bool:
    """Return whether a reading is in metres and says where its origin lies and which way its y runs."""
    if not isinstance(reading, dict) or reading.get("unit", "m") != "m" or "drawing_top" not in reading:
        return False
    origin = reading.get("drawing_origin")
    return isinstance(origin, list) and [isinstance(x, int | float) for x in origin] == [True, True]


def downgrade() -> None:
    with op.batch_alter_table("revisions") as table:
        table.drop_column("drawing_frame")
    with op.batch_alter_table("layers") as table:
        table.drop_constraint(op.f("fk_layers_accepted_by_keys"), type_="foreignkey")
        table.drop_column("accepted_at")
        table.drop_column("accepted_by")
