"""Engines and transactions, the same on SQLite and PostgreSQL."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from sqlalchemy import URL, Engine, create_engine, event, make_url
from sqlalchemy.exc import OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeout
from sqlalchemy.orm import Session

from service import crash_points
from service.domain.errors import DatabaseBusy
from service.domain.plain import plain_dumps, plain_loads, plain_text

_BUSY_TIMEOUT_S = 15.0


def open_engine(url: str | URL) -> Engine:
    """Return an engine for a SQLAlchemy URL: WAL, foreign keys and immediate transactions on SQLite.

    Notes
    -----
    pysqlite begins transactions lazily and not at all before a SELECT; it is switched to autocommit
    and every transaction begins with BEGIN IMMEDIATE, so that two writers queue instead of failing
    at their commit (SQLAlchemy, "Serializable isolation / Savepoints / Transactional DDL").

    Text of files and clients is made plain here, on its way to the database and back, whichever column
    it is for: one lone surrogate in a row would else end every list that shows it.
    """
    shared: dict[str, Any] = {"json_serializer": plain_dumps, "json_deserializer": plain_loads}
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

    @property
    def is_sqlite(self) -> bool:
        """Return whether this is the embedded default."""
        return self.engine.dialect.name == "sqlite"

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
        """
        try:
            with Session(self.engine, expire_on_commit=False) as session, session.begin():
                yield session
                session.flush()
                crash_points.reach(f"{point}.before-commit")
        except (OperationalError, PoolTimeout) as error:
            raise _busy(error) from error
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
            raise _busy(error) from error

    def close(self) -> None:
        """Close every connection."""
        self.engine.dispose()


def _busy(error: Exception) -> DatabaseBusy:
    return DatabaseBusy(
        "The database did not answer in time; ask again in a few seconds.",
        retry_after_s=2,
        cause=type(error).__name__,
    )
