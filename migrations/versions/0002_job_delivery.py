"""The job delivery's own tables and functions, on PostgreSQL (procrastinate's schema)."""

from __future__ import annotations

import procrastinate
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None

_THINGS = (
    ("FUNCTION", "SELECT oid::regprocedure::text FROM pg_proc WHERE starts_with(proname, 'procrastinate_')"),
    ("TABLE", "SELECT quote_ident(tablename) FROM pg_tables WHERE starts_with(tablename, 'procrastinate_')"),
    ("TYPE", "SELECT quote_ident(typname) FROM pg_type WHERE starts_with(typname, 'procrastinate_')"),
)


def upgrade() -> None:
    bind = op.get_bind()
    if bind.dialect.name == "postgresql":
        manager = procrastinate.schema.SchemaManager(procrastinate.PsycopgConnector())
        # psycopg runs many statements at once only without parameters, and reads % as text then
        driver = bind.connection.driver_connection
        assert driver is not None
        driver.execute(manager.get_schema())


def downgrade() -> None:
    bind = op.get_bind()
    if bind.dialect.name != "postgresql":
        return
    for kind, query in _THINGS:
        for (name,) in bind.exec_driver_sql(query).fetchall():
            bind.exec_driver_sql(f"DROP {kind} IF EXISTS {name} CASCADE")
