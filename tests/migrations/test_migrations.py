"""The schema's steps: up, down and up again, no drift from the models, and rows that survive."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import JSON, Boolean, DateTime, Engine, MetaData, String, Table, inspect, select

from service.db import schema
from service.db.models import Base, Map
from service.db.session import Database, open_engine


@pytest.fixture(params=["sqlite", pytest.param("postgres", marks=pytest.mark.postgres)])
def engine(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Engine]:
    url = (
        f"sqlite:///{tmp_path / 'groundplan.sqlite3'}"
        if request.param == "sqlite"
        else request.getfixturevalue("empty_postgres_url")
    )
    engine = open_engine(url)
    yield engine
    engine.dispose()


def _ours(name: str | None, kind: str, _parents: object) -> bool:
    return kind != "table" or name is None or not name.startswith("procrastinate_")


def test_the_steps_make_what_the_models_say(engine: Engine) -> None:
    schema.upgrade(engine)
    with engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"include_name": _ours, "compare_type": True})
        assert compare_metadata(context, Base.metadata) == []
    assert schema.is_current(engine)


def test_check_constraints_are_those_of_the_models(engine: Engine) -> None:
    schema.upgrade(engine)
    for table in Base.metadata.tables.values():
        wanted = {str(c.name) for c in table.constraints if type(c).__name__ == "CheckConstraint"}
        found = {str(c["name"]) for c in inspect(engine).get_check_constraints(table.name)}
        assert found == wanted, table.name


def test_up_down_and_up_again_leaves_nothing_behind(engine: Engine) -> None:
    schema.upgrade(engine)
    schema.downgrade(engine, to="base")
    assert inspect(engine).get_table_names() == ["alembic_version"]
    assert not schema.is_current(engine)
    schema.upgrade(engine)
    assert schema.is_current(engine)


def test_a_row_survives_the_later_steps(engine: Engine) -> None:
    schema.upgrade(engine, to="0001")
    db = Database(engine)
    moment = datetime(2026, 1, 2, 3, 4, 5, 678901, tzinfo=UTC)
    row = {"id": "map_1", "site": "Gifu", "name": "Hall", "created_at": moment, "updated_at": moment}
    with db.writing("create-map") as session:
        session.add(Map(**row))
    schema.upgrade(engine)
    with db.reading() as session:
        kept = session.execute(select(Map)).scalar_one()
        assert {name: getattr(kept, name) for name in row} == row
        assert kept.next_revision == 1


def test_upgrading_twice_changes_nothing(engine: Engine) -> None:
    schema.upgrade(engine)
    before = sorted(inspect(engine).get_table_names())
    schema.upgrade(engine)
    assert sorted(inspect(engine).get_table_names()) == before


def _steps() -> list[str]:
    script = ScriptDirectory(str(resources.files("migrations")))
    return [step.revision for step in reversed(list(script.walk_revisions()))]


def _fill(engine: Engine) -> dict[str, list[dict[str, Any]]]:
    """Put one row into every table of ours, each of which refers to the rows before it."""
    found = _reflected(engine)
    made: dict[str, dict[str, Any]] = {}
    with engine.begin() as connection:
        for table in found.sorted_tables:
            made[table.name] = _row(table, made)
            connection.execute(table.insert().values(made[table.name]))
    return _rows(engine)


def _row(table: Table, made: dict[str, dict[str, Any]]) -> dict[str, Any]:
    row: dict[str, Any] = {}
    for column in table.columns:
        to = next(iter(column.foreign_keys)).column if column.foreign_keys else None
        if to is not None and to.table.name in made:
            row[column.name] = made[to.table.name][to.name]
        elif to is not None:
            assert column.nullable, column
        elif column.name in _CHECKED and isinstance(column.type, String):
            row[column.name] = _CHECKED[column.name]
        elif isinstance(column.type, DateTime):
            row[column.name] = datetime(2026, 1, 2, 3, 4, 5, 678901, tzinfo=UTC)
        elif isinstance(column.type, JSON):
            row[column.name] = {}
        elif isinstance(column.type, Boolean):
            row[column.name] = False
        elif isinstance(column.type, String):
            row[column.name] = "x"
        else:
            row[column.name] = 1
    return row


_CHECKED: dict[str, Any] = {"role": "admin", "state": "succeeded", "status": "ready"}
"""Values that the tables' check constraints allow."""


def _reflected(engine: Engine) -> MetaData:
    found = MetaData()
    found.reflect(engine, only=lambda name, _: not name.startswith(("procrastinate_", "alembic_", "sqlite_")))
    return found


def _rows(engine: Engine) -> dict[str, list[dict[str, Any]]]:
    found = _reflected(engine)
    with engine.connect() as connection:
        return {
            name: [dict(row) for row in connection.execute(select(table)).mappings()]
            for name, table in found.tables.items()
        }


@pytest.mark.parametrize("step", _steps()[:1])
def test_rows_that_refer_to_each_other_survive_up_and_down(engine: Engine, step: str) -> None:
    schema.upgrade(engine, to=step)
    before = _fill(engine)
    assert all(len(rows) == 1 for rows in before.values())
    schema.upgrade(engine)
    assert schema.is_current(engine)
    _same(before, _rows(engine))
    schema.downgrade(engine, to=step)
    _same(before, _rows(engine))
    with engine.connect() as connection:
        if engine.dialect.name == "sqlite":
            assert connection.exec_driver_sql("PRAGMA foreign_key_check").fetchall() == []
            assert connection.exec_driver_sql("PRAGMA foreign_keys").scalar() == 1


def _same(before: dict[str, list[dict[str, Any]]], after: dict[str, list[dict[str, Any]]]) -> None:
    for name, rows in before.items():
        assert len(after[name]) == len(rows), name
        both = [column for column in rows[0] if column in after[name][0]]
        assert [[row[c] for c in both] for row in after[name]] == [[row[c] for c in both] for row in rows]
