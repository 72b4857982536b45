"""A PostgreSQL server of the test session's own: private, on a unix socket, gone when the session ends.

`postgres_url` gives a fresh database with the present schema, `empty_postgres_url` one with none. The
schema is made once, in a template that each database is cloned from. Where tests run in several processes,
that which started them has the one server for all.
"""

from __future__ import annotations

import os
import pwd
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Any

import psutil
import psycopg
import pytest

from tests.patience import PATIENCE_S

_TEMPLATE = "groundplan_template"
_SHARED = "groundplan_postgres"
_PREFIX = "gp-pg-"


class PostgresServer:
    """Hold one running server and make databases in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._numbers = count(1)
        self._whose = os.environ.get("PYTEST_XDIST_WORKER", "test")

    def url(self, database: str, *, driver: str = "postgresql+psycopg") -> str:
        """Return a URL of the database; `driver` "postgresql" makes it one for libpq."""
        return f"{driver}://groundplan@/{database}?host={self.folder}"

    def program(self, name: str) -> Path:
        """Return one of the programs of this server's version: pg_dump, psql."""
        return _programs() / name

    @contextmanager
    def database(self, *, template: str = "template0") -> Iterator[str]:
        """Give the URL of a new database, and drop it in the end, whoever is still connected."""
        name = f"{self._whose}_{next(self._numbers)}"
        self.execute(f'CREATE DATABASE "{name}" TEMPLATE "{template}"')
        try:
            yield self.url(name)
        finally:
            self.execute(f'DROP DATABASE "{name}" WITH (FORCE)')

    def execute(self, statement: str) -> None:
        """Run one statement as the owner of the server."""
        with self._owner() as owner:
            owner.execute(statement.encode())

    @contextmanager
    def turn(self) -> Iterator[None]:
        """Let no other process of the session be in such a block at the same time."""
        with self._owner() as owner:
            owner.execute("SELECT pg_advisory_lock(1)")
            yield

    def has(self, database: str) -> bool:
        """Return whether there is a database of that name."""
        with self._owner() as owner:
            return owner.execute("SELECT 1 FROM pg_database WHERE datname = %s", [database]).rowcount > 0

    def _owner(self) -> psycopg.Connection[tuple[Any, ...]]:
        return psycopg.connect(self.url("postgres", driver="postgresql"), autocommit=True)


def _installed() -> list[Path]:
    """Return the folders of the programs of all servers on this machine, the newest last."""
    found = Path("/usr/lib/postgresql").glob("*/bin/initdb")
    return [path.parent for path in sorted(found, key=lambda path: int(path.parts[-3].split(".")[0]))]


def _programs() -> Path:
    """Return the folder of the newest server's programs, or skip (in CI: fail)."""
    if found := _installed():
        return found[-1]
    missing = "PostgreSQL's server is not installed: run tools/setup --tests"
    if os.environ.get("CI"):
        pytest.fail(missing)
    pytest.skip(missing)


def _as_unprivileged(folder: Path) -> list[str]:
    """Return the words to put before a command so that it is not root's, as PostgreSQL demands."""
    if os.geteuid() != 0:
        return []
    try:
        account = pwd.getpwnam("postgres")
    except KeyError:
        account = pwd.getpwnam("nobody")
    os.chown(folder, account.pw_uid, account.pw_gid)
    return ["setpriv", f"--reuid={account.pw_uid}", f"--regid={account.pw_gid}", "--clear-groups"]


def _sweep() -> None:
    """Remove the folders of servers whose sessions were killed: they died with them, the folders stay."""
    for lock in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*/data/postmaster.pid"):
        with suppress(OSError, ValueError, IndexError):
            if not psutil.pid_exists(int(lock.read_text().split()[0])):
                shutil.rmtree(lock.parents[1], ignore_errors=True)


@contextmanager
def running_server() -> Iterator[PostgresServer]:
    """Start a server in a new folder under the system's temporary one, and stop it in the end."""
    programs = _programs()
    _sweep()
    folder = Path(tempfile.mkdtemp(prefix=_PREFIX))  # not tmp_path: short, and open to another account
    before = _as_unprivileged(folder)
    try:
        _run([*before, str(programs / "initdb"), "-D", str(folder / "data"), "-U", "groundplan"], folder)
        settings = {
            "listen_addresses": "",
            "unix_socket_directories": str(folder),
            "max_connections": "200",
            "fsync": "off",  # nobody cuts this machine's power in a test
            "full_page_writes": "off",
        }
        options = [word for name, value in settings.items() for word in ("-c", f"{name}={value}")]
        # die with the session, even if it is killed
        ward = [*(before or ["setpriv"]), "--pdeathsig", "INT"]
        command = [*ward, str(programs / "postgres"), "-D", str(folder / "data"), *options]
        with (folder / "log").open("wb") as log:
            process = subprocess.Popen(command, stdout=log, stderr=log, cwd=folder)
        try:
            server = PostgresServer(folder)
            _wait_until_it_answers(server, process)
            yield server
        finally:
            process.send_signal(signal.SIGINT)  # fast shutdown: connections are cut
            process.wait(timeout=PATIENCE_S)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _run(command: list[str], folder: Path) -> None:
    options = ["-E", "UTF8", "--locale=C.UTF-8", "--auth=trust", "--no-sync"]
    done = subprocess.run([*command, *options], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def _wait_until_it_answers(server: PostgresServer, process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            server.execute("SELECT 1")
        except psycopg.OperationalError:
            if process.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError((server.folder / "log").read_text()) from None
            time.sleep(0.05)
        else:
            return


_OPEN = ExitStack()


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: Any) -> None:
    """Tell a process that runs tests for this one where the server is; start that for the first."""
    if not hasattr(node.config, _SHARED):
        server = _OPEN.enter_context(running_server()) if _installed() else None
        setattr(node.config, _SHARED, None if server is None else str(server.folder))
    node.workerinput[_SHARED] = getattr(node.config, _SHARED)


def pytest_unconfigure() -> None:
    """Stop the server, if it was this process that started it for others."""
    _OPEN.close()


@pytest.fixture(scope="session")
def postgres_server(request: pytest.FixtureRequest) -> Iterator[PostgresServer]:
    """Give the session's server."""
    shared = getattr(request.config, "workerinput", {}).get(_SHARED)
    if shared is not None:
        yield PostgresServer(Path(shared))
        return
    with running_server() as server:
        yield server


@pytest.fixture(scope="session")
def postgres_template(postgres_server: PostgresServer) -> str:
    """Give the name of a database with the present schema, to clone."""
    from service.db import schema  # noqa: PLC0415 - a test without a database loads none of it
    from service.db.session import open_engine  # noqa: PLC0415

    with postgres_server.turn():
        if not postgres_server.has(_TEMPLATE):
            postgres_server.execute(f'CREATE DATABASE "{_TEMPLATE}" TEMPLATE template0')
            engine = open_engine(postgres_server.url(_TEMPLATE))
            schema.upgrade(engine)
            engine.dispose()
    return _TEMPLATE


@pytest.fixture
def postgres_url(postgres_server: PostgresServer, postgres_template: str) -> Iterator[str]:
    """Give the SQLAlchemy URL of a fresh database with the present schema."""
    with postgres_server.database(template=postgres_template) as url:
        yield url


@pytest.fixture
def empty_postgres_url(postgres_server: PostgresServer) -> Iterator[str]:
    """Give the SQLAlchemy URL of a fresh database without any table."""
    with postgres_server.database() as url:
        yield url
