"""The real service under the real uvicorn, in a process of its own, on a free port with a folder of its own.

Fixtures: `server` (SQLite), `postgres_served` (PostgreSQL), `admin` (a client with the first admin key), and
`client_for(role, maps)`, which gives a client with a new key.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import httpx
import psutil
import pytest

from service.app import open_kernel
from service.settings import Settings
from service.usecases.kernel import Kernel
from tests.forked import Forked, forked
from tests.patience import PATIENCE_S
from tests.schemas import bring_to_head

ROOT = Path(__file__).resolve().parent.parent
ClientFor = Callable[..., httpx.Client]


@dataclass
class Server:
    """Hold a running service: its address, its first admin key, its process, and a kernel on its data."""

    url: str
    admin_key: str
    process: subprocess.Popen[str] | Forked
    settings: Settings
    kernel: Kernel
    log: Path
    ready_after_s: float
    _clients: list[httpx.Client] = field(default_factory=list)

    @property
    def rss_bytes(self) -> int:
        """Return the memory that the process holds."""
        rss: int = psutil.Process(self.process.pid).memory_info().rss
        return rss

    def client(self, key: str | None) -> httpx.Client:
        """Return an HTTP client with this key; closed with the server."""
        headers = {} if key is None else {"Authorization": f"Bearer {key}"}
        client = httpx.Client(base_url=self.url, headers=headers, timeout=PATIENCE_S)
        self._clients.append(client)
        return client

    def stop(self, sig: signal.Signals = signal.SIGTERM) -> int:
        """Return the exit status of the process after a signal."""
        if self.process.poll() is None:
            self.process.send_signal(sig)
        try:
            return self.process.wait(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise

    def close(self) -> None:
        """Stop the process and close everything."""
        for client in self._clients:
            client.close()
        try:
            self.stop()
        finally:
            assert self.process.stdout is not None
            self.process.stdout.close()
            self.kernel.db.close()


def environment(settings: Settings, **more: str) -> dict[str, str]:
    """Return the environment that gives a process these settings, with compiled modules kept."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("GROUNDPLAN_")}
    kept.pop("PYTHONDONTWRITEBYTECODE", None)
    told = {
        "GROUNDPLAN_DATA_DIR": str(settings.data_dir),
        "GROUNDPLAN_PORT": "0",
        "GROUNDPLAN_MAX_UPLOAD_BYTES": str(settings.max_upload_bytes),
        "GROUNDPLAN_UPLOAD_EXPIRY_S": str(settings.upload_expiry_s),
        "PYTHONUNBUFFERED": "1",
    }
    if settings.database_url is not None:
        told["GROUNDPLAN_DATABASE_URL"] = settings.database_url.get_secret_value()
    return kept | told | more


def start(
    settings: Settings,
    *,
    admin_key: str | None = None,
    by_itself: bool = False,
    stderr: IO[str] | None = None,
    **more: str,
) -> Server:
    """Return a started service on these settings; its database is migrated first.

    Parameters
    ----------
    admin_key : str, optional
        The first admin key, where an earlier start has printed it.
    by_itself : bool
        Whether Python starts anew for it, imports included, rather than by a fork.
    stderr : file, optional
        Where its log goes instead of `Server.log`; closed here once the process has it.
    **more : str
        Environment variables of the process alone.
    """
    settings.data_dir.mkdir(parents=True, exist_ok=True)
    log = settings.data_dir / "service.log"
    surroundings = environment(settings, **more)
    kernel = open_kernel(settings)
    bring_to_head(kernel.db)
    begun = time.monotonic()
    with stderr or log.open("a", encoding="utf-8") as sink:
        process = (
            subprocess.Popen(
                [sys.executable, "-m", "service", "serve"],
                stdout=subprocess.PIPE,
                stderr=sink,
                text=True,
                cwd=ROOT,
                env=surroundings,
            )
            if by_itself
            else forked("service", "serve", stdout=subprocess.PIPE, stderr=sink, env=surroundings)
        )
    try:
        url, printed = _announced(process, log)
        key = admin_key or printed
        assert key is not None, "the service printed no key: give the one that an earlier start printed"
    except BaseException:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()
        kernel.db.close()
        raise
    return Server(url, key, process, settings, kernel, log, time.monotonic() - begun)


def _announced(process: subprocess.Popen[str] | Forked, log: Path) -> tuple[str, str | None]:
    """Return the address, and the key if one is printed, from the process's standard output."""
    assert process.stdout is not None
    watch = threading.Timer(PATIENCE_S, process.kill)
    watch.start()
    key = None
    try:
        for line in process.stdout:
            if found := re.search(r"\bgp_[\w-]+", line):
                key = found[0]
            if found := re.search(r"http://\S+", line):
                return found[0], key
    finally:
        watch.cancel()
    raise RuntimeError(f"the service did not start; it said:\n{log.read_text(encoding='utf-8')[-4000:]}")


@contextmanager
def running(settings: Settings, *, by_itself: bool = False, **more: str) -> Iterator[Server]:
    """Run a service until the block ends; see `start`."""
    server = start(settings, by_itself=by_itself, **more)
    try:
        yield server
    finally:
        server.close()


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """Give a service on SQLite, shared by the tests of a module."""
    with running(Settings(data_dir=tmp_path_factory.mktemp("service"))) as started:
        yield started


@pytest.fixture
def postgres_served(postgres_url: str, tmp_path: Path) -> Iterator[Server]:
    """Give a service on a new PostgreSQL database."""
    with running(Settings(data_dir=tmp_path / "data", database_url=postgres_url)) as started:
        yield started


@pytest.fixture(scope="module")
def admin(server: Server) -> httpx.Client:
    """Give a client with the first admin key."""
    return server.client(server.admin_key)


@pytest.fixture(scope="module")
def client_for(server: Server) -> ClientFor:
    """Give a function: a client with a new key of a role, for some maps or (None) all."""

    def make(role: str, maps: Sequence[str] | None = None) -> httpx.Client:
        return new_client(server, role, maps=maps)

    return make


def new_client(server: Server, role: str, *, maps: Sequence[str] | None = None) -> httpx.Client:
    """Return a client with a new key of a role, for some maps or (None) all."""
    body = {"name": f"{role} of a test", "role": role, "map_ids": None if maps is None else list(maps)}
    answer = server.client(server.admin_key).post("/v1/keys", json=body)
    assert answer.status_code == 201, answer.text
    return server.client(answer.json()["key"])
