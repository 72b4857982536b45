"""Databases with the present schema: made by the migrations once and then copied, as most tests need one."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path

from service.db.schema import upgrade
from service.db.session import Database, open_engine


def bring_to_head(database: Database) -> None:
    """Give a database the present schema: a new SQLite file by copying, anything else by its migrations."""
    named = database.engine.url.database
    if database.is_sqlite and named is not None and not Path(named).exists():
        Path(named).write_bytes(_sqlite_at_head())
    else:
        upgrade(database.engine)


@cache
def _sqlite_at_head() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "head.db"
        engine = open_engine(f"sqlite:///{made}")
        upgrade(engine)
        engine.dispose()  # the last connection to close takes the write-ahead log into the file
        return made.read_bytes()
