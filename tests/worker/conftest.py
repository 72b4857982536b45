"""A workbench on each database."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.worker.workbench import Workbench

DATABASES = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]


def url_of(database: str, request: pytest.FixtureRequest, folder: Path) -> str:
    """Return the URL of a fresh database of the kind."""
    if database == "sqlite":
        return f"sqlite:///{folder}/groundplan.sqlite3"
    url: str = request.getfixturevalue("postgres_url")
    return url


@pytest.fixture(params=DATABASES)
def bench(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Workbench]:
    """Give an installation with one map on SQLite, then on PostgreSQL; its workers are the test's."""
    made = Workbench(tmp_path / "data", url_of(request.param, request, tmp_path))
    made.prepare()
    yield made
    made.close()


@pytest.fixture
def sqlite_bench(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Workbench]:
    """Give an installation on SQLite alone."""
    made = Workbench(tmp_path / "data", url_of("sqlite", request, tmp_path))
    made.prepare()
    yield made
    made.close()
