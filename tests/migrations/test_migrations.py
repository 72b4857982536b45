"""The schema's steps: up, down and up again, no drift from the models, and rows that survive."""

from __future__ import annotations

import os
import re
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from pydantic import SecretStr
from sqlalchemy import Engine, inspect, select

from service.app import open_kernel
from service.db import schema
from service.db.models import Base, Map
from service.db.session import Database, open_engine
from service.domain.lifecycle import Role
from service.settings import Settings
from service.usecases.keys import create_key_at_the_console
from tests.migrations.filling import ROWS, Rows, fill, read, reflected, shape
from tests.migrations.ladder import PostgresLadder, SqliteLadder
from tests.postgres import PostgresServer
from tests.server import environment, start


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


@pytest.fixture(scope="module")
def ladders() -> dict[str, SqliteLadder | PostgresLadder]:
    """Give a place for what is made once, by the kind of database."""
    return {}


@pytest.fixture(params=["sqlite", pytest.param("postgres", marks=pytest.mark.postgres)])
def ladder(
    request: pytest.FixtureRequest,
    ladders: dict[str, SqliteLadder | PostgresLadder],
    tmp_path_factory: pytest.TempPathFactory,
) -> SqliteLadder | PostgresLadder:
    """Give databases at each step."""
    if request.param not in ladders:
        ladders[request.param] = (
            SqliteLadder(STEPS, tmp_path_factory.mktemp("ladder"))
            if request.param == "sqlite"
            else PostgresLadder(STEPS, request.getfixturevalue("postgres_server"))
        )
    return ladders[request.param]


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


STEPS = _steps()
OPERATIONS = Path(__file__).parents[2] / "docs" / "operations.md"


def _same(before: Rows, after: Rows) -> None:
    """Hold that no row went, and none changed in a column that is still there."""
    for name in before.keys() & after.keys():
        shared = before[name][0].keys() & after[name][0].keys()
        assert [{c: r[c] for c in shared} for r in after[name]] == [
            {c: r[c] for c in shared} for r in before[name]
        ], name


def _whole(engine: Engine) -> None:
    """Hold that nothing refers to what is not there, and that the keys are watched again."""
    if engine.dialect.name == "sqlite":
        with engine.connect() as connection:
            assert connection.exec_driver_sql("PRAGMA foreign_key_check").fetchall() == []
            assert connection.exec_driver_sql("PRAGMA foreign_keys").scalar() == 1


def test_rows_of_every_table_survive_every_step_up_and_down(engine: Engine) -> None:
    shapes: dict[str, object] = {}
    rows: Rows = {}
    for step in STEPS:
        schema.upgrade(engine, to=step)
        _same(rows, read(engine))
        _whole(engine)
        rows = fill(engine)
        assert all(len(rows[name]) == ROWS for name in rows)
        shapes[step] = shape(engine)
    for step in reversed(STEPS[:-1]):
        rows = fill(engine)
        schema.downgrade(engine, to=step)
        _same(rows, read(engine))
        _whole(engine)
        assert shape(engine) == shapes[step], step


@pytest.mark.parametrize("step", STEPS[:-1])
def test_an_earlier_schema_with_rows_comes_to_the_newest_and_back_in_one_go(
    ladder: SqliteLadder | PostgresLadder, step: str
) -> None:
    with ladder.at(step) as engine:
        rows, before = fill(engine), shape(engine)
        schema.upgrade(engine)
        assert schema.is_current(engine)
        after = read(engine)
        assert rows.keys() <= after.keys()
        _same(rows, after)
        _whole(engine)
        schema.downgrade(engine, to=step)
        assert read(engine) == rows
        assert shape(engine) == before
        _whole(engine)


@pytest.mark.parametrize("says_which_way_y_runs", [True, False])
def test_who_took_a_layer_in_and_where_its_drawing_lies_are_found_in_earlier_rows(
    engine: Engine, *, says_which_way_y_runs: bool
) -> None:
    schema.upgrade(engine, to="0018")
    rows = fill(engine)
    revisions = sorted(rows["revisions"], key=lambda row: row["n"])
    frame = {"drawing_origin": [51_234.0, -8.5], "drawing_top": None}
    tables = reflected(engine).tables
    with engine.begin() as connection:
        same = {"layer_id": "lyr_1", "placement_id": rows["placements"][0]["id"]}
        connection.execute(tables["layers"].update().values(same))
        at = {"map_id": rows["maps"][0]["id"], "drawing_id": rows["drawings"][0]["id"]}
        connection.execute(tables["revisions"].update().values(at))
        told = {**frame, "unit": "m"}
        if not says_which_way_y_runs:  # the first versions did not
            del told["drawing_top"]
        reading = {"reading": told, "walls_sha256": revisions[1]["walls_sha256"]}
        connection.execute(
            tables["drawings"].update().where(tables["drawings"].c.id == at["drawing_id"]).values(reading)
        )
    schema.upgrade(engine, to="0019")
    after = read(engine)
    first = revisions[0]
    assert {row["accepted_by"] for row in after["layers"]} == {first["created_by"]}
    assert {row["accepted_at"] for row in after["layers"]} == {first["created_at"]}
    found = {row["id"]: row["drawing_frame"] for row in after["revisions"]}
    is_known = {row["id"]: says_which_way_y_runs and row is revisions[1] for row in revisions}
    assert found == {key: frame if known else None for key, known in is_known.items()}


def test_what_a_step_down_loses_is_listed(engine: Engine) -> None:
    listed = dict(re.findall(r"^\| (\d{4}) -> \d{4} \| (.+) \|$", OPERATIONS.read_text(), re.MULTILINE))
    schema.upgrade(engine)
    lost: dict[str, set[str]] = {}
    for higher, lower in zip(reversed(STEPS), reversed(STEPS[:-1]), strict=False):
        before = reflected(engine).tables
        schema.downgrade(engine, to=lower)
        after = reflected(engine).tables
        lost[higher] = {name for name in before if name not in after} | {
            f"{name}.{column.name}"
            for name in before.keys() & after.keys()
            for column in before[name].columns
            if column.name not in after[name].columns
        }
    told = {step: set(re.findall(r"`([\w.]+)`", text)) for step, text in listed.items()}
    assert told == {step: names for step, names in lost.items() if names}


def test_a_row_that_refers_to_nothing_stops_the_step_and_nothing_is_changed(tmp_path: Path) -> None:
    file = tmp_path / "groundplan.sqlite3"
    engine = open_engine(f"sqlite:///{file}")
    schema.upgrade(engine, to=STEPS[-2])
    fill(engine)
    with sqlite3.connect(file) as careless:  # a tool that does not watch the keys
        careless.execute("DELETE FROM maps WHERE id = 'ma-0'")
    careless.close()
    rows = read(engine)
    with pytest.raises(
        schema.ReferencesBroken, match=r"nothing was changed: .*refer to maps that are not there"
    ):
        schema.upgrade(engine)
    assert read(engine) == rows
    with engine.connect() as connection:
        assert connection.exec_driver_sql("SELECT version_num FROM alembic_version").scalar() == STEPS[-2]
        assert connection.exec_driver_sql("PRAGMA foreign_keys").scalar() == 1
    engine.dispose()


def test_alembic_by_itself_takes_the_same_way(tmp_path: Path) -> None:
    engine = open_engine(f"sqlite:///{tmp_path / 'groundplan.sqlite3'}")
    schema.upgrade(engine, to=STEPS[-2])
    rows = fill(engine)
    told = os.environ | {"GROUNDPLAN_DATA_DIR": str(tmp_path)}
    for words in (["upgrade", "head"], ["downgrade", STEPS[0]], ["upgrade", "head"]):
        done = subprocess.run(
            [sys.executable, "-m", "alembic", *words], env=told, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
    assert schema.is_current(engine)
    assert [row["id"] for row in read(engine)["revisions"]] == [row["id"] for row in rows["revisions"]]
    engine.dispose()


@pytest.mark.parametrize("step", [STEPS[0], STEPS[len(STEPS) // 2], STEPS[-2]])
def test_a_backup_of_an_older_version_restores(tmp_path: Path, step: str) -> None:
    """As docs/operations.md says: the copy put back, `groundplan migrate`, and the service serves it."""
    old, new = tmp_path / "old.sqlite3", tmp_path / "data" / "groundplan.sqlite3"
    new.parent.mkdir()
    engine = open_engine(f"sqlite:///{old}")
    schema.upgrade(engine, to=step)
    rows = fill(engine)
    with sqlite3.connect(old) as running, sqlite3.connect(new) as copy:
        running.backup(copy)
    running.close()
    copy.close()
    engine.dispose()
    settings = Settings(data_dir=new.parent)
    _put_back_blobs(settings, rows)
    _migrate(settings)
    _serves(settings, rows)


@pytest.mark.postgres
def test_a_dump_of_an_older_version_restores(tmp_path: Path, postgres_server: PostgresServer) -> None:
    dump = tmp_path / "backup.sql"
    with postgres_server.database() as old, postgres_server.database() as new:
        engine = open_engine(old)
        schema.upgrade(engine, to=STEPS[len(STEPS) // 2])
        rows = fill(engine)
        engine.dispose()
        for program, url, words in (("pg_dump", old, ["-f", dump]), ("psql", new, ["-q", "-f", dump])):
            told = [postgres_server.program(program), *words, url.replace("+psycopg", "")]
            done = subprocess.run(told, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
        settings = Settings(data_dir=tmp_path, database_url=SecretStr(new))
        _put_back_blobs(settings, rows)
        _migrate(settings)
        _serves(settings, rows)


def _put_back_blobs(settings: Settings, rows: Rows) -> None:
    for row in rows["blobs"]:
        place = settings.data_dir / "blobs" / row["sha256"][:2] / row["sha256"]
        place.parent.mkdir(parents=True, exist_ok=True)
        place.touch()


def _migrate(settings: Settings) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "service", "migrate"],
        env=environment(settings),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def _serves(settings: Settings, rows: Rows) -> None:
    """Hold that the service answers on the restored database with the maps that were in it."""
    kernel = open_kernel(settings)
    key = create_key_at_the_console(kernel, name="after", role=Role.ADMIN, map_ids=None)
    kernel.db.close()
    server = start(settings, admin_key=key.secret)
    try:
        client = server.client(key.secret)
        assert client.get("/readyz").status_code == 200
        found = client.get("/v1/maps").json()["items"]
        assert sorted(item["id"] for item in found) == [row["id"] for row in rows["maps"]]
    finally:
        server.close()
