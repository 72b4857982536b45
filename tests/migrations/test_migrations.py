"""The schema's steps: up, down and up again, no drift from the models, and rows that survive."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import Engine, inspect, select

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
