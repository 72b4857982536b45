"""What each process does at its start on a database whose schema is another version's, or none."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from pydantic import SecretStr
from sqlalchemy import text

from service.app import open_kernel
from service.db.schema import downgrade, version
from service.settings import Settings
from tests import web
from tests.patience import PATIENCE_S
from tests.schemas import bring_to_head
from tests.server import ROOT, environment, running

BRIDGE = {"GROUNDPLAN_MQTT_URL": "mqtt://127.0.0.1:9", "GROUNDPLAN_PUBLIC_URL": "http://127.0.0.1"}
CHECKING = {
    "serve": ("service", "serve"),
    "key": ("service", "key", "create", "--role", "robot"),
    "worker": ("worker",),
    "vda5050": ("worker.vda5050",),
}
MIGRATING = {"migrate": ("service", "migrate"), "up": ("worker.cli", "up")}


@pytest.fixture(params=["sqlite", pytest.param("postgres", marks=pytest.mark.postgres)])
def settings(request: pytest.FixtureRequest, tmp_path: Path) -> Settings:
    """Give the settings of an installation on an empty database."""
    url = SecretStr(request.getfixturevalue("postgres_url")) if request.param == "postgres" else None
    return Settings(data_dir=tmp_path / "data", database_url=url)


def _schema(settings: Settings, state: str) -> str | None:
    """Bring the database to a state: none, older, newer; return its version."""
    kernel = open_kernel(settings)
    try:
        bring_to_head(kernel.db)
        if state in {"none", "older"}:
            downgrade(kernel.db.engine, to={"none": "base", "older": "-1"}[state])
        if state == "newer":
            with kernel.db.engine.begin() as connection:
                connection.execute(text("UPDATE alembic_version SET version_num = '9000'"))
        return version(kernel.db.engine)
    finally:
        kernel.db.close()


def _refusals(settings: Settings, commands: dict[str, tuple[str, ...]]) -> dict[str, str]:
    """Return what each command says on stderr, once all have ended, each by refusing."""
    surroundings = environment(settings, **BRIDGE)
    processes = {
        name: subprocess.Popen(
            [sys.executable, "-m", *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=ROOT,
            env=surroundings,
        )
        for name, words in commands.items()
    }
    said = {}
    try:
        for name, process in processes.items():
            printed, said[name] = process.communicate(timeout=PATIENCE_S)
            assert (process.returncode, printed) == (1, ""), (name, said[name])
    finally:
        for process in processes.values():
            process.kill()
            process.communicate()
    return said


@pytest.mark.parametrize("state", ["none", "older"])
def test_what_can_be_migrated_is_refused_until_it_is(settings: Settings, state: str) -> None:
    before = _schema(settings, state)
    for name, said in _refusals(settings, CHECKING).items():
        assert said.startswith(f"groundplan {name}: The database "), said
        assert "run `groundplan migrate` first" in said
        assert len(said.splitlines()) == 1
    assert _schema_now(settings) == before


def test_a_newer_schema_is_refused_by_all_and_left_alone(settings: Settings) -> None:
    _schema(settings, "newer")
    for name, said in _refusals(settings, CHECKING | MIGRATING).items():
        lines = said.splitlines()
        assert "has the schema 9000 of a newer version" in lines[0], said
        assert "groundplan migrate` first" not in said
        assert len(lines) == 1 + (name == "up"), said
    assert _schema_now(settings) == "9000"


@pytest.mark.parametrize(("state", "told"), [("older", "groundplan migrate"), ("newer", "9000 of a newer")])
def test_a_running_service_says_so_to_all_and_not_where_the_database_is(
    settings: Settings, state: str, told: str
) -> None:
    with running(settings) as server:
        _schema(settings, state)
        answer = web.get(f"{server.url}/readyz")
    assert answer.status_code == 503
    assert told in answer.text
    assert str(settings.data_dir) not in answer.text
    assert "postgresql" not in answer.text


def _schema_now(settings: Settings) -> str | None:
    kernel = open_kernel(settings)
    try:
        return version(kernel.db.engine)
    finally:
        kernel.db.close()
