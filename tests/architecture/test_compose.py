"""The compose file and the images: each process's very command, environment and health check, run natively.

There is no engine here. What the file says is started on this machine, against a real PostgreSQL, with
only the hosts, ports and folders put in their place.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from sqlalchemy.engine import make_url

from tests.architecture.sources import ROOT

pytestmark = pytest.mark.slow

FILE = ROOT / "docker-compose.yml"
PROCESSES = ("migrate", "service", "worker")
DATA_DIR = "/var/lib/groundplan"
EVERYWHERE = "0.0.0.0"  # noqa: S104 - inside a container
VARIABLE = re.compile(r"\$\{(\w+):-([^}]*)\}")
PASSWORD_FILE = "GROUNDPLAN_DATABASE_PASSWORD_FILE"  # noqa: S105
METRICS_PORTS = ("9464", "9465")
START_S = 60.0
GIB = 1 << 30
STOPPED = (0, -signal.SIGTERM)  # uvicorn ends its answers, then passes the signal on to itself
EXTRA = ("scipy", "open3d", "numba", "cv2", "skimage", "PIL", "plyfile", "pypcd4", "shapely", "lzf")


@pytest.fixture(scope="module")
def compose() -> dict[str, Any]:
    loaded: dict[str, Any] = yaml.safe_load(FILE.read_text())
    return loaded


@pytest.fixture
def port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        number: int = probe.getsockname()[1]
        return number


def _native(text: str, *, url: str, data_dir: Path, port: int) -> str:
    """Return a string of the compose file with this machine's database, folder and port in it."""
    text = VARIABLE.sub(r"\2", text)
    if text.startswith("postgresql+psycopg://"):
        return url
    if text in METRICS_PORTS:
        return "0"  # several processes of a kind share this machine's ports
    return text.replace(DATA_DIR, str(data_dir)).replace(EVERYWHERE, "127.0.0.1").replace("8000", str(port))


class Natively:
    """Run a process of the compose file on this machine."""

    def __init__(self, compose: dict[str, Any], *, url: str, data_dir: Path, port: int) -> None:
        self._services = compose["services"]
        self._place = {"url": url, "data_dir": data_dir, "port": port}
        self._data_dir = data_dir

    def _words(self, words: list[str]) -> list[str]:
        placed = [_native(word, **self._place) for word in words]
        program = Path(sys.executable).parent / placed[0]
        return [str(program), *placed[1:]]

    def _environment(self, name: str) -> dict[str, str]:
        said = {
            key: _native(str(value), **self._place)
            for key, value in self._services[name]["environment"].items()
            if key != PASSWORD_FILE  # this machine's PostgreSQL asks for none
        }
        kept = {key: os.environ[key] for key in ("PATH", "HOME", "LANG") if key in os.environ}
        return {**kept, **said}

    def run(self, name: str, **more: str) -> subprocess.CompletedProcess[str]:
        """Run a one-shot process to its end."""
        return subprocess.run(
            self._words(self._services[name]["command"]),
            cwd=self._data_dir,
            env=self._environment(name) | more,
            capture_output=True,
            text=True,
            timeout=START_S,
            check=False,
        )

    def logged(self, name: str, words: str) -> int:
        """Return how many processes of a name have written some words."""
        return sum(words in file.read_text() for file in self._data_dir.glob(f"{name}*") if file.is_file())

    def is_healthy(self, name: str) -> bool:
        """Return what the process's health check says."""
        kind, *words = self._services[name]["healthcheck"]["test"]
        assert kind == "CMD"
        done = subprocess.run(
            self._words(words), env=self._environment(name), capture_output=True, timeout=START_S, check=False
        )
        return done.returncode == 0

    @contextmanager
    def running(self, name: str, **more: str) -> Iterator[subprocess.Popen[bytes]]:
        """Run a process in the background; it is killed in the end if it still runs."""
        with tempfile.NamedTemporaryFile(dir=self._data_dir, prefix=name, delete=False) as output:
            process = subprocess.Popen(
                self._words(self._services[name]["command"]),
                cwd=self._data_dir,
                env=self._environment(name) | more,
                stdout=output,
                stderr=subprocess.STDOUT,
            )
        try:
            yield process
        finally:
            process.kill()
            process.wait()


def _until_healthy(natively: Natively, name: str, process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + START_S
    while not natively.is_healthy(name):
        assert process.poll() is None, f"{name} ended with {process.returncode}"
        assert time.monotonic() < deadline, f"{name} did not become healthy"
        time.sleep(0.2)


def _stop(process: subprocess.Popen[bytes]) -> int:
    process.send_signal(signal.SIGTERM)
    return process.wait(timeout=START_S)


@pytest.fixture
def natively(compose: dict[str, Any], empty_postgres_url: str, tmp_path: Path, port: int) -> Natively:
    return Natively(compose, url=empty_postgres_url, data_dir=tmp_path, port=port)


def test_docker_compose_accepts_the_file() -> None:
    program = shutil.which("docker-compose")
    if program is None:
        assert not os.environ.get("CI"), "docker-compose is not installed: run tools/setup --tests"
        pytest.skip("docker-compose is not installed: run tools/setup --tests")
    clean = {
        key: value for key, value in os.environ.items() if not key.startswith(("POSTGRES", "GROUNDPLAN"))
    }

    def config(**more: str) -> subprocess.CompletedProcess[str]:
        command = [program, "-f", str(FILE), "config", "-q"]
        return subprocess.run(
            command, cwd=ROOT, env=clean | more, capture_output=True, text=True, check=False
        )

    done = config(POSTGRES_PASSWORD="x")  # noqa: S106
    assert (done.returncode, done.stderr) == (0, "")
    for without in ({}, {"POSTGRES_PASSWORD": ""}):
        done = config(**without)
        assert done.returncode != 0
        assert "POSTGRES_PASSWORD" in done.stderr


def test_every_container_is_confined(compose: dict[str, Any]) -> None:
    for name, service in compose["services"].items():
        assert service["read_only"] is True, name
        assert service["cap_drop"] == ["ALL"], name
        assert "cap_add" not in service, name
        assert service["security_opt"] == ["no-new-privileges:true"], name
        assert service["mem_limit"], name
        assert service["pids_limit"] > 0, name
        assert "privileged" not in service, name
    users = {name: _user(service) for name, service in compose["services"].items()}
    assert set(users.values()) == {"postgres", "nginx", "groundplan"}


def _user(service: dict[str, Any]) -> str:
    """Return who a container runs as: what the file says, or else its image's last word."""
    if "user" in service:
        return str(service["user"])
    lines = (ROOT / service["build"]["dockerfile"]).read_text().splitlines()
    return [line.split()[1] for line in lines if line.startswith("USER ")][-1]


def test_the_front_has_the_blobs_alone_and_cannot_write_them(compose: dict[str, Any]) -> None:
    front = compose["services"]["front"]
    assert front["volumes"] == ["tls:/etc/groundplan/tls", "blobs:/var/lib/groundplan/blobs:ro"]
    assert front["networks"] == ["door"]
    beside = [name for name, service in compose["services"].items() if "door" in service.get("networks", [])]
    assert sorted(beside) == ["front", "service"]
    assert compose["networks"]["inner"] == {"internal": True}


def test_one_process_alone_has_the_password_in_its_environment(
    compose: dict[str, Any], tmp_path: Path
) -> None:
    known = [
        name
        for name, service in compose["services"].items()
        if any("${POSTGRES_PASSWORD" in str(value) for value in service.get("environment", {}).values())
    ]
    assert known == ["password"]
    said = compose["services"]["password"]["command"]
    words = [word.replace("/run/groundplan", str(tmp_path)).replace("$$", "$") for word in said]
    secret = "p@ss/w:rd %41 'x'"  # noqa: S105
    subprocess.run(words, env={**os.environ, "POSTGRES_PASSWORD": secret}, check=True)
    file = tmp_path / "postgres-password"
    assert (file.read_text(), file.stat().st_mode & 0o777) == (secret, 0o644)
    from service.settings import Settings  # noqa: PLC0415

    url = compose["services"]["service"]["environment"]["GROUNDPLAN_DATABASE_URL"]
    made = make_url(Settings(database_url=url, database_password_file=file).url())
    assert (made.password, made.username, made.host) == (secret, "groundplan", "postgres")


def test_images_can_be_pinned_and_the_workers_is_compiled(compose: dict[str, Any]) -> None:
    for name in ("service", "worker", "front"):
        lines = (ROOT / "docker" / f"{name}.Dockerfile").read_text().splitlines()
        outside = [line.split()[1] for line in lines if line.startswith("FROM ") and ":" in line]
        assert outside
        assert all("DIGEST}" in image for image in outside)
    assert compose["services"]["postgres"]["image"] == "postgres:15-bookworm${POSTGRES_DIGEST:-}"
    worker = (ROOT / "docker" / "worker.Dockerfile").read_text()
    folder = re.search(r"NUMBA_CACHE_DIR=(\S+)", worker)
    assert folder is not None
    assert f"compiled:{folder[1]}" in compose["services"]["worker"]["volumes"]
    assert f"COPY --from=compiled --chown=groundplan:groundplan {folder[1]} {folder[1]}" in worker


def test_a_job_comes_to_its_limit_of_memory_before_the_containers(compose: dict[str, Any]) -> None:
    """A worker and its warm child stand beside the job: past the container's limit all three are killed."""
    from service.domain.bounds import Bounds  # noqa: PLC0415

    worker = compose["services"]["worker"]
    job, container = (
        VARIABLE.sub(r"\2", str(said))
        for said in (worker["environment"]["GROUNDPLAN_JOB_MEMORY_BYTES"], worker["mem_limit"])
    )
    assert container.endswith("g")
    assert int(container.removesuffix("g")) * GIB - int(job) >= GIB
    assert int(job) >= 1.2 * 136 * Bounds().max_points, "the largest scan has room"


def test_the_file_holds_no_secret_and_every_process_checks_its_health(compose: dict[str, Any]) -> None:
    services = compose["services"]
    assert set(services) == {"postgres", "front", "vda5050", "password", *PROCESSES}
    assert services["password"]["environment"]["POSTGRES_PASSWORD"].startswith("${POSTGRES_PASSWORD:?")
    assert {name for name in services if "healthcheck" not in services[name]} == {"migrate", "password"}
    for name in ("service", "worker"):
        assert services[name]["depends_on"]["migrate"]["condition"] == "service_completed_successfully"
    assert {name for name in services if "ports" in services[name]} == {"front"}, "the front is the only door"


def test_every_variable_is_a_setting(compose: dict[str, Any]) -> None:
    from service.settings import Settings  # noqa: PLC0415

    known = {f"GROUNDPLAN_{name.upper()}" for name in Settings.model_fields}
    for name in PROCESSES:
        assert set(compose["services"][name]["environment"]) <= known


@pytest.mark.postgres
def test_the_schema_is_made_once_and_made_again_without_harm(natively: Natively) -> None:
    for _ in range(2):
        done = natively.run("migrate")
        assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.postgres
def test_the_service_becomes_healthy_and_stops_when_told(natively: Natively) -> None:
    assert natively.run("migrate").returncode == 0
    assert not natively.is_healthy("service")
    with natively.running("service") as process:
        _until_healthy(natively, "service", process)
        assert _stop(process) in STOPPED


@pytest.mark.postgres
def test_two_workers_become_healthy_and_stop_when_told(natively: Natively) -> None:
    assert natively.run("migrate").returncode == 0
    with natively.running("worker") as first, natively.running("worker") as second:
        for process in (first, second):
            _until_healthy(natively, "worker", process)
        deadline = time.monotonic() + START_S
        while natively.logged("worker", "the worker started") < 2:
            assert time.monotonic() < deadline, "a worker did not say that it started"
            time.sleep(0.1)
        assert [_stop(process) for process in (first, second)] == [0, 0]


@pytest.mark.postgres
def test_the_service_image_needs_nothing_of_the_workers_extra(natively: Natively, tmp_path: Path) -> None:
    """Run migrate, serve and key where every package of the worker's extra is missing, as in the image."""
    folder = tmp_path / "without-extra"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(
        "import sys\n"
        f"EXTRA = {EXTRA!r}\n"
        "class Missing:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name.split('.')[0] in EXTRA:\n"
        "            raise ModuleNotFoundError(f'No module named {name!r}', name=name)\n"
        "sys.meta_path.insert(0, Missing())\n"
    )
    without = {"PYTHONPATH": str(folder)}
    assert natively.run("migrate", **without).returncode == 0
    with natively.running("service", **without) as process:
        _until_healthy(natively, "service", process)
        assert _stop(process) in STOPPED


@pytest.mark.parametrize("name", ["service", "worker"])
def test_an_image_says_the_same_as_the_compose_file(compose: dict[str, Any], name: str) -> None:
    lines = (ROOT / "docker" / f"{name}.Dockerfile").read_text().splitlines()
    process = compose["services"][name]
    commands = [line.removeprefix("CMD ") for line in lines if line.startswith("CMD ")]
    assert [json.loads(command) for command in commands] == [process["command"]]
    checks = [line.partition(" CMD ")[2] for line in lines if line.startswith("HEALTHCHECK ")]
    assert [["CMD", *json.loads(check)] for check in checks] == [process["healthcheck"]["test"]]
    assert {line for line in lines if line.startswith("USER ")} == {"USER groundplan"}
    synced = [line for line in lines if "uv sync" in line]
    assert all(("--extra worker" in line) == (name == "worker") and "--locked" in line for line in synced)
