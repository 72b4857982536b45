"""Engines and transactions, the same on SQLite and PostgreSQL.

Whoever takes part in a transaction has `Session` from here: nothing outside this package knows SQLAlchemy.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sqlalchemy import URL, Engine, create_engine, event, make_url, text
from sqlalchemy.exc import OperationalError, SQLAlchemyError
from sqlalchemy.exc import TimeoutError as PoolTimeout
from sqlalchemy.orm import Session

from service import crash_points
from service.domain.errors import DatabaseBusy, StorageFull, Unavailable
from service.domain.plain import plain_dumps, plain_loads, plain_text

__all__ = ["Database", "SQLAlchemyError", "Session", "open_engine"]

_BUSY_TIMEOUT_S = 15.0
_FULL_RETRY_AFTER_S = 60
_PG_DISK_FULL = "53100"
_SQLITE_FAILS_TO_WRITE = {sqlite3.SQLITE_IOERR, sqlite3.SQLITE_CANTOPEN}
_NEXT_WRITE_BYTES = 1 << 20
"""Less than this is free where SQLite may find no room for its next page, or 32 KiB of the WAL's index."""


def open_engine(url: str | URL) -> Engine:
    """Return an engine for a SQLAlchemy URL: WAL, foreign keys and immediate transactions on SQLite.

    Notes
    -----
    pysqlite begins transactions lazily and not at all before a SELECT; it is switched to autocommit
    and every transaction begins with BEGIN IMMEDIATE, so that two writers queue instead of failing
    at their commit (SQLAlchemy, "Serializable isolation / Savepoints / Transactional DDL").

    Text of files and clients is made plain here, on its way to the database and back, whichever column
    it is for: one lone surrogate in a row would else end every list that shows it.

    Errors do not tell the values given to a statement: a new webhook's secret is one, and logs keep errors.
    """
    shared: dict[str, Any] = {
        "json_serializer": plain_dumps,
        "json_deserializer": plain_loads,
        "hide_parameters": True,
    }
    if make_url(url).get_backend_name() == "sqlite":
        engine = _sqlite_engine(url, shared)
    else:
        engine = create_engine(
            url, pool_size=5, max_overflow=15, pool_timeout=_BUSY_TIMEOUT_S, pool_pre_ping=True, **shared
        )
    event.listen(engine, "before_cursor_execute", _make_plain, retval=True)
    return engine


def _make_plain(
    _connection: Any,
    _cursor: Any,
    statement: str,
    parameters: Any,
    _context: Any,
    executemany: bool,  # noqa: FBT001 - the interface
) -> tuple[str, Any]:
    """Return a statement with plain texts: in what it stores, and in what it compares stored things with."""
    if executemany:
        return statement, [_plain_row(row) for row in parameters]
    return statement, _plain_row(parameters)


def _plain_row(row: Any) -> Any:
    if isinstance(row, dict):
        return {name: plain_text(v) if isinstance(v, str) else v for name, v in row.items()}
    return tuple(plain_text(v) if isinstance(v, str) else v for v in row)


def _sqlite_engine(url: str | URL, shared: dict[str, Any]) -> Engine:
    engine = create_engine(
        url, connect_args={"timeout": _BUSY_TIMEOUT_S, "check_same_thread": False}, **shared
    )

    @event.listens_for(engine, "connect")
    def _configure(connection: sqlite3.Connection, _record: Any) -> None:
        connection.isolation_level = None
        connection.execute("PRAGMA journal_mode=WAL")
        connection.execute("PRAGMA synchronous=FULL")
        connection.execute("PRAGMA foreign_keys=ON")

    @event.listens_for(engine, "begin")
    def _begin(connection: Any) -> None:
        readonly = connection.get_execution_options().get("readonly", False)
        connection.exec_driver_sql("BEGIN" if readonly else "BEGIN IMMEDIATE")

    return engine


class Database:
    """Give transactions on one database; opened once by a composition root and passed on."""

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        self.writes = 0
        """Counts the transactions of this process that were committed: whoever caches rows looks at it."""
        self.unsure_commits = 0
        """Counts those that were asked to commit and got no answer: the server may commit them yet."""

    @property
    def is_sqlite(self) -> bool:
        """Return whether this is the embedded default."""
        return self.engine.dialect.name == "sqlite"

    @property
    def driver_error(self) -> type[Exception]:
        """Return the class of what the database's driver itself raises, on a connection that is taken raw."""
        error: type[Exception] = self.engine.dialect.loaded_dbapi.Error
        return error

    @contextmanager
    def writing(self, point: str) -> Iterator[Session]:
        """Give a session whose changes are committed together when the block ends, or not at all.

        Parameters
        ----------
        point : str
            Name of this transaction; its crash points are ``<point>.before-commit`` and
            ``<point>.after-commit``.

        Raises
        ------
        DatabaseBusy
            If the database gave no connection or lock in time.
        StorageFull
            If the disk of the database has no room.
        """
        is_asked = False
        try:
            with Session(self.engine, expire_on_commit=False) as session, session.begin():
                yield session
                session.flush()
                crash_points.reach(f"{point}.before-commit")
                is_asked = True
        except (OperationalError, PoolTimeout) as error:
            refusal = _unavailable(error, self.engine)
            self.unsure_commits += is_asked and not isinstance(refusal, StorageFull)
            raise refusal from error
        except BaseException:
            self.unsure_commits += is_asked
            raise
        self.writes += 1
        crash_points.reach(f"{point}.after-commit")

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """Give a session that sees one state of the database and changes nothing.

        Raises
        ------
        DatabaseBusy
            If the database gave no connection in time.
        """
        try:
            with (
                self.engine.connect().execution_options(readonly=True) as connection,
                Session(connection) as session,
            ):
                yield session
        except (OperationalError, PoolTimeout) as error:
            raise _unavailable(error, self.engine) from error

    def prove(self) -> None:
        """Ask the database for nothing, so that one which cannot be used is known now.

        Raises
        ------
        DatabaseBusy
            If the database gave no connection in time.
        """
        with self.reading() as session:
            session.execute(text("SELECT 1"))

    def close(self) -> None:
        """Close every connection."""
        self.engine.dispose()


def _unavailable(error: Exception, engine: Engine) -> Unavailable:
    if _tells_full_disk(getattr(error, "orig", None), engine):
        return StorageFull(
            "The disk of the server's database is full. Tell an admin; what is asked for works again as soon"
            " as there is room.",
            retry_after_s=_FULL_RETRY_AFTER_S,
        )
    return DatabaseBusy(
        "The database did not answer in time; ask again in a few seconds.",
        retry_after_s=2,
        cause=type(error).__name__,
    )


def _tells_full_disk(error: Any, engine: Engine) -> bool:
    """Return whether the database's own error means a full disk.

    SQLite says so only where `write` does; where it cannot make or map a file beside the database, it says
    "disk I/O error" or "unable to open", whatever the cause: then the disk itself is looked at.
    """
    if getattr(error, "sqlstate", None) == _PG_DISK_FULL:
        return True
    code = getattr(error, "sqlite_errorcode", None)
    if code is None or engine.url.database is None:
        return False
    kind = code & 0xFF
    return kind == sqlite3.SQLITE_FULL or (kind in _SQLITE_FAILS_TO_WRITE and _is_full(engine.url.database))


def _is_full(database: str) -> bool:
    found = os.statvfs(Path(database).parent)
    has_no_names = found.f_files > 0 and found.f_favail == 0
    return has_no_names or found.f_bavail * found.f_frsize < _NEXT_WRITE_BYTES
