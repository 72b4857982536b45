"""PostgreSQL tells the services of what they stream: events, jobs that move on, keys that end."""

from __future__ import annotations

from alembic import op

revision = "0014"
down_revision = "0013"
branch_labels = None
depends_on = None

_TOLD = {
    "publications": "INSERT",
    "robot_reports": "INSERT",
    "jobs": "UPDATE OF changed",
    "keys": "UPDATE OF revoked_at, expires_at OR DELETE",
}


def upgrade() -> None:
    if op.get_bind().dialect.name != "postgresql":
        return
    op.execute(
        "CREATE FUNCTION groundplan_tell_changes() RETURNS trigger LANGUAGE plpgsql AS"
        " $$ BEGIN PERFORM pg_notify('groundplan_changes', ''); RETURN NULL; END $$"
    )
    for table, what in _TOLD.items():
        op.execute(
            f"CREATE TRIGGER tell_changes AFTER {what} ON {table}"
            " FOR EACH STATEMENT EXECUTE FUNCTION groundplan_tell_changes()"
        )


def downgrade() -> None:
    if op.get_bind().dialect.name != "postgresql":
        return
    for table in _TOLD:
        op.execute(f"DROP TRIGGER tell_changes ON {table}")
    op.execute("DROP FUNCTION groundplan_tell_changes()")
