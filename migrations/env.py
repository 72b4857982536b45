"""Alembic's environment: which database, which tables, and how a step runs."""

from __future__ import annotations

from typing import Any

from alembic import context

from service.db.models import Base
from service.db.schema import stepping
from service.db.session import open_engine
from service.settings import Settings


def _ours(name: str | None, kind: str, _parents: Any) -> bool:
    """Return whether autogenerate looks at this thing: the job delivery's own tables are not ours."""
    return kind != "table" or name is None or not name.startswith("procrastinate_")


def _run(connection: Any) -> None:
    context.configure(
        connection=connection,
        target_metadata=Base.metadata,
        render_as_batch=True,
        include_name=_ours,
        compare_type=True,
    )
    with context.begin_transaction():
        if connection.dialect.name == "postgresql":
            connection.exec_driver_sql("SET LOCAL lock_timeout = '10s'")
        context.run_migrations()


def _main() -> None:
    given = context.config.attributes.get("connection")
    if given is not None:
        _run(given)
        return
    engine = open_engine(Settings().url())
    with stepping(engine) as connection:
        _run(connection)
    engine.dispose()


_main()
