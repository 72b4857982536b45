"""How a service learns that something was written, by whichever process, without looking at the rows."""

from __future__ import annotations

import sqlite3
import threading
from abc import ABC, abstractmethod
from typing import Any

import structlog
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.pool import PoolProxiedConnection

from service.db.session import Database

CHANNEL = "groundplan_changes"
_COUNT_EVERY_S = 0.2
_CONNECT_AGAIN_S = 1.0

log = structlog.get_logger(__name__)


class Changes(ABC):
    """Wait for writes, on a connection of its own; one thread at a time may wait, any may close.

    A connection that broke is made anew. What is missed meanwhile is what a wait's time is for.

    Parameters
    ----------
    database : Database
        Where something may be written.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self._connection: PoolProxiedConnection | None = None
        self._closing = threading.Event()

    def wait(self, *, timeout_s: float) -> None:
        """Return as soon as something may have been written, and after `timeout_s` at the latest."""
        try:
            if self._connection is None:
                self._connection = self._database.engine.raw_connection()
                self._prepare(self._connection.driver_connection)
            self._wait(self._connection.driver_connection, timeout_s)
        except (SQLAlchemyError, self._database.driver_error) as error:
            log.warning("changes are not told at present and are looked for", cause=repr(error))
            self._drop()
            self._closing.wait(min(timeout_s, _CONNECT_AGAIN_S))
        if self._closing.is_set():
            self._drop()

    def close(self) -> None:
        """End the waiting: at once on SQLite, with its time on PostgreSQL."""
        self._closing.set()

    def _drop(self) -> None:
        if self._connection is not None:
            self._connection.invalidate()
            self._connection = None

    @abstractmethod
    def _prepare(self, connection: Any) -> None:
        """Make a new connection ready for waiting."""

    @abstractmethod
    def _wait(self, connection: Any, timeout_s: float) -> None:
        """Wait on the driver's own connection."""


class Counted(Changes):
    """Ask SQLite every fifth of a second how many commits others have made.

    Notes
    -----
    `PRAGMA data_version` reads no page and costs some microseconds. As nothing is written through this
    connection, it counts every commit, those of this process included.
    """

    _version: int | None = None

    def _prepare(self, connection: Any) -> None:  # noqa: ARG002 - the interface
        self._version = None

    def _wait(self, connection: Any, timeout_s: float) -> None:
        waited_s = 0.0
        while True:
            before, self._version = self._version, _data_version(connection)
            if self._version != before or waited_s >= timeout_s or self._closing.wait(_COUNT_EVERY_S):
                return
            waited_s += _COUNT_EVERY_S


class Notified(Changes):
    """Be notified by PostgreSQL, where triggers tell of what services stream (migration 0014)."""

    def _prepare(self, connection: Any) -> None:
        connection.autocommit = True
        connection.execute(f"LISTEN {CHANNEL}")

    def _wait(self, connection: Any, timeout_s: float) -> None:
        for _ in connection.notifies(timeout=timeout_s, stop_after=1):
            pass


def _data_version(connection: sqlite3.Connection) -> int:
    version: int = connection.execute("PRAGMA data_version").fetchone()[0]
    return version


def open_changes(database: Database) -> Changes:
    """Return the way to wait for writes that fits the database."""
    return Counted(database) if database.is_sqlite else Notified(database)
