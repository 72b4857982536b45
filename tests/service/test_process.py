"""The service's process: what it loads, how it starts, refuses to start, and stops."""

from __future__ import annotations

import json
import re
import shutil
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

import httpx
import pytest

from service.app import open_kernel
from service.settings import Settings
from tests import web
from tests.commands import documented
from tests.patience import PATIENCE_S
from tests.schemas import bring_to_head
from tests.server import ROOT, Server, environment, running, start
from tests.service.asking import a_map, ok
from tests.service.by_hand import ByHand

MIB = 1024 * 1024
DRIVERS = ("psycopg", "asyncpg")
HEAVY = (
    "scipy",
    "numba",
    "open3d",
    "cv2",
    "PIL",
    "skimage",
    "shapely",
    "plyfile",
    "pypcd4",
    "ezdxf",
)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """Give a service that Python started anew, as a person starts it."""
    with running(Settings(data_dir=tmp_path_factory.mktemp("service")), by_itself=True) as started:
        yield started


def _run(settings: Settings, *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "service", *words]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=ROOT, env=environment(settings)
    )


def _migrated(settings: Settings) -> Settings:
    settings.data_dir.mkdir(parents=True, exist_ok=True)
    kernel = open_kernel(settings)
    bring_to_head(kernel.db)
    kernel.db.close()
    return settings


def test_the_service_loads_nothing_heavy() -> None:
    code = "import json, sys, service.cli; print(json.dumps(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    loaded = {name.partition(".")[0] for name in json.loads(done.stdout)}
    assert not loaded & {*HEAVY, *DRIVERS}
    assert "worker" not in loaded


def test_the_service_is_small_at_rest(server: Server) -> None:
    ok(web.get(server.url + "/readyz"))
    assert server.rss_bytes < 150 * MIB


def test_an_unmigrated_database_is_refused(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    for words in (("serve",), ("key", "create", "--role", "robot")):
        done = _run(settings, *words)
        assert (done.returncode, done.stdout) == (1, "")
        assert "run `groundplan migrate` first" in done.stderr
        assert len(done.stderr.splitlines()) == 1
    assert _run(settings, "migrate").returncode == 0
    made = _run(settings, "key", "create", "--role", "robot", "--name", "r2")
    assert (made.returncode, re.fullmatch(r"gp_[\w-]{43}\n", made.stdout) is not None) == (0, True)


@pytest.mark.parametrize("where", ["sqlite", pytest.param("postgres", marks=pytest.mark.postgres)])
def test_what_was_migrated_is_told_as_json(
    tmp_path: Path, where: str, request: pytest.FixtureRequest
) -> None:
    url = request.getfixturevalue("postgres_url") if where == "postgres" else None
    settings = Settings(data_dir=tmp_path, database_url=url)
    first, again = (json.loads(_run(settings, "migrate", "--json").stdout) for _ in range(2))
    assert list(first) == documented("migrate")
    assert again == {"schema_before": first["schema"], "schema": first["schema"]}
    assert re.fullmatch(r"\d{4}", first["schema"])


def test_a_key_made_at_the_console_is_told_as_the_api_tells_one(server: Server, admin: httpx.Client) -> None:
    map_id = a_map(admin)
    words = ("key", "create", "--role", "tablet", "--name", "t1", "--map", map_id, "--json")
    made = json.loads(_run(server.settings, *words).stdout)
    assert list(made) == documented("key create")
    listed = next(one for one in ok(admin.get("/v1/keys"))["items"] if one["id"] == made["id"])
    same = {name: made[name] for name in listed if name != "created_at"}
    assert same == {name: value for name, value in listed.items() if name != "created_at"}
    assert datetime.fromisoformat(made["created_at"]) == datetime.fromisoformat(listed["created_at"])
    assert ok(server.client(made["key"]).get("/v1/maps"))["items"][0]["id"] == map_id


def _with_files(settings: Settings) -> Server:
    with running(settings, by_itself=True) as server:
        ByHand(server.kernel).drawing(a_map(server.client(server.admin_key)), read=False)
    return server


def _refused_without_blobs(settings: Settings, server: Server) -> None:
    """Hide the folder of the blobs by an empty one, as a new volume does."""
    blobs, hidden = settings.data_dir / "blobs", settings.data_dir / "hidden"
    blobs.rename(hidden)
    for _ in range(2):  # the first start made the empty folders
        for command in ("migrate", "serve"):
            done = _run(settings, command)
            assert (done.returncode, done.stdout) == (1, "")
            assert "-v groundplan_blobs:/to groundplan-service cp -a /from/blobs/. /to/" in done.stderr
            assert len(done.stderr.splitlines()) == 1
    shutil.copytree(hidden, blobs, dirs_exist_ok=True)
    assert _run(settings, "migrate").returncode == 0
    started = start(settings, admin_key=server.admin_key, by_itself=True)
    started.close()


def test_a_store_left_behind_is_refused_on_sqlite(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "data")
    _refused_without_blobs(settings, _with_files(settings))


@pytest.mark.postgres
def test_a_store_left_behind_is_refused_on_postgres(tmp_path: Path, postgres_url: str) -> None:
    settings = Settings(data_dir=tmp_path / "data", database_url=postgres_url)
    _refused_without_blobs(settings, _with_files(settings))


@pytest.mark.parametrize(
    ("variables", "said"),
    [
        ({"GROUNDPLAN_PORT": "x"}, "port"),
        ({"GROUNDPLAN_LOG_LEVEL": "loud"}, "loud"),
        ({"GROUNDPLAN_DATABASE_URL": "postgresql+psycopg://u:hush@127.0.0.1:1/x"}, "cannot be used"),
        ({"GROUNDPLAN_CRASH_AT": "nowhere"}, "nowhere"),
    ],
)
def test_a_wrong_setting_is_one_line(tmp_path: Path, variables: dict[str, str], said: str) -> None:
    settings = Settings(data_dir=tmp_path)
    done = subprocess.run(
        [sys.executable, "-m", "service", "serve"],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
        env=environment(settings, **variables),
    )
    assert done.returncode == 1
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert "hush" not in done.stderr


@pytest.mark.parametrize("module", ["worker", "worker.vda5050"])
@pytest.mark.parametrize(
    ("variables", "said"),
    [
        ({"GROUNDPLAN_PORT": "x"}, "port"),
        ({"GROUNDPLAN_DATABASE_URL": "hush", "GROUNDPLAN_DATABASE_PASSWORD_FILE": "/none"}, "/none"),
    ],
)
def test_a_wrong_setting_of_another_process_is_one_line(
    tmp_path: Path, module: str, variables: dict[str, str], said: str
) -> None:
    done = subprocess.run(
        [sys.executable, "-m", module],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
        env=environment(Settings(data_dir=tmp_path), **variables),
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert "hush" not in done.stderr


def test_a_taken_port_is_one_line(tmp_path: Path) -> None:
    settings = _migrated(Settings(data_dir=tmp_path))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        done = _run(settings, "serve", "--port", str(taken.getsockname()[1]))
    assert done.returncode == 1
    assert "Address already in use" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_key_at_the_console_is_for_maps_that_exist(server: Server, admin: httpx.Client) -> None:
    map_id = a_map(admin)
    made = _run(server.settings, "key", "create", "--role", "tablet", "--map", map_id)
    tablet = server.client(made.stdout.strip())
    assert [m["id"] for m in ok(tablet.get("/v1/maps"))["items"]] == [map_id]
    refused = _run(server.settings, "key", "create", "--role", "tablet", "--map", "map_none")
    assert (refused.returncode, refused.stdout) == (1, "")
    assert "map-not-found" in refused.stderr


def test_the_first_key_is_printed_once(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    first = start(settings, by_itself=True)
    first.close()
    second = start(settings, admin_key=first.admin_key, by_itself=True)
    try:
        ok(second.client(first.admin_key).get("/v1/keys"))
        assert first.admin_key not in first.log.read_text(encoding="utf-8")
    finally:
        second.close()
    with pytest.raises(AssertionError, match="printed no key"):
        start(settings, by_itself=True)


def _first_keys(settings: Settings) -> list[str]:
    """Return the keys printed by two services that start at once on the same data."""
    _migrated(settings)
    found: list[str] = []
    processes = [
        subprocess.Popen(
            [sys.executable, "-m", "service", "serve"],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            cwd=ROOT,
            env=environment(settings),
        )
        for _ in range(2)
    ]
    for process in processes:
        assert process.stdout is not None
        for line in process.stdout:
            found += re.findall(r"\bgp_[\w-]+", line)
            if "listens at" in line:
                break
    for process in processes:
        process.terminate()
        process.communicate()
        assert process.returncode == 0
    return found


def test_of_two_services_that_start_one_makes_the_key_on_sqlite(tmp_path: Path) -> None:
    assert len(_first_keys(Settings(data_dir=tmp_path))) == 1


@pytest.mark.postgres
def test_of_two_services_that_start_one_makes_the_key_on_postgres(tmp_path: Path, postgres_url: str) -> None:
    settings = Settings(data_dir=tmp_path, database_url=postgres_url)
    assert len(_first_keys(settings)) == 1


def test_a_stopping_service_ends_its_event_streams(tmp_path: Path) -> None:
    with running(Settings(data_dir=tmp_path), by_itself=True) as server:
        admin = server.client(server.admin_key)
        map_id = a_map(admin)
        ByHand(server.kernel).drawing(map_id, read=False)
        job_id = ok(admin.get("/v1/jobs"))["items"][0]["id"]
        ended = threading.Event()
        heard = threading.Event()

        def listen() -> None:
            with admin.stream("GET", f"/v1/jobs/{job_id}/events") as answer:
                for _ in answer.iter_lines():
                    heard.set()
            ended.set()

        listener = threading.Thread(target=listen)
        listener.start()
        assert heard.wait(timeout=PATIENCE_S)
        assert server.stop() == 0
        listener.join(timeout=PATIENCE_S)
        assert ended.is_set()
