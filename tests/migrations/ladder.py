"""Databases without rows at each step of the schema: each made once from the one below, and then copied."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import Engine

from service.db import schema
from service.db.session import open_engine
from tests.postgres import PostgresServer


class SqliteLadder:
    """Give SQLite databases, which are copied as files."""

    def __init__(self, steps: Sequence[str], folder: Path) -> None:
        self._steps, self._folder = steps, folder

    @contextmanager
    def at(self, step: str) -> Iterator[Engine]:
        """Give a database that has just come to a step."""
        copy = self._folder / "copy.sqlite3"
        shutil.copy(self._made(step), copy)
        with _opened(f"sqlite:///{copy}") as engine:
            yield engine
        copy.unlink()

    def _made(self, step: str) -> Path:
        place, n = self._folder / f"{step}.sqlite3", self._steps.index(step)
        if not place.exists():
            if n:
                shutil.copy(self._made(self._steps[n - 1]), place)
            with _opened(f"sqlite:///{place}") as engine:
                schema.upgrade(engine, to=step)
        return place


class PostgresLadder:
    """Give PostgreSQL databases, which the server copies."""

    def __init__(self, steps: Sequence[str], server: PostgresServer) -> None:
        self._steps, self._server = steps, server
        self._names: dict[str, str] = {}

    @contextmanager
    def at(self, step: str) -> Iterator[Engine]:
        """Give a database that has just come to a step."""
        with self._server.database(template=self._made(step)) as url, _opened(url) as engine:
            yield engine

    def _made(self, step: str) -> str:
        n = self._steps.index(step)
        if step not in self._names:
            below = self._made(self._steps[n - 1]) if n else "template0"
            name = f"at_{step}"
            self._server.execute(f'CREATE DATABASE "{name}" TEMPLATE "{below}"')
            with _opened(self._server.url(name)) as engine:
                schema.upgrade(engine, to=step)
            self._names[step] = name
        return self._names[step]


@contextmanager
def _opened(url: str) -> Iterator[Engine]:
    engine = open_engine(url)
    try:
        yield engine
    finally:
        engine.dispose()  # the last connection to close takes SQLite's write-ahead log into the file
