"""A service with a real worker and a map: files and texts go in as people send them."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
from pydantic import SecretStr

from service.settings import Settings
from tests.every_list import Look
from tests.forked import forked
from tests.patience import PATIENCE_S
from tests.postgres import PostgresServer
from tests.server import Server, environment, running
from tests.service.asking import a_map, ended, ok

LOOPBACK = {"GROUNDPLAN_WEBHOOK_NETWORKS": "127.0.0.0/8"}


@dataclass(frozen=True)
class Desk:
    """Hold a service with a worker, a map to upload to, and what was seen of it so far."""

    server: Server
    client: httpx.Client
    map_id: str
    look: Look

    def sent(self, purpose: str, name: str, content: bytes) -> httpx.Response:
        """Return the answer to an upload, `drawings` or `scans`."""
        return self.client.post(f"/v1/maps/{self.map_id}/{purpose}", files={"file": (name, content)})

    def ended(self, job: dict[str, Any]) -> dict[str, Any]:
        """Return a job once it has ended, after a look at every list and all that is new."""
        job = ended(self.client, job["id"])
        self.look.news()
        return job

    def told(self, purpose: str, name: str, content: bytes) -> dict[str, Any]:
        """Return the problem with which the reading of a file fails."""
        job = self.ended(ok(self.sent(purpose, name, content), 202)["job"])
        assert job["state"] == "failed", job
        problem: dict[str, Any] = job["problem"]
        return problem


@contextmanager
def served(request: pytest.FixtureRequest, folder: Path) -> Iterator[Server]:
    """Give a service on the database that the fixture's parameter names, `sqlite` or `postgres`."""
    if request.param == "sqlite":
        with running(Settings(data_dir=folder), **LOOPBACK) as server:
            yield server
        return
    cluster: PostgresServer = request.getfixturevalue("postgres_server")
    with (
        cluster.database() as url,
        running(Settings(data_dir=folder, database_url=SecretStr(url)), **LOOPBACK) as server,
    ):
        yield server


@contextmanager
def at_desk(request: pytest.FixtureRequest, folder: Path) -> Iterator[Desk]:
    """Give a desk, with a real worker; in the end every list and every thing of it still answers."""
    with served(request, folder) as server, working(server):
        client = server.client(server.admin_key)
        desk = Desk(server, client, a_map(client), Look(client))
        yield desk
        desk.look.everywhere()


@contextmanager
def working(server: Server) -> Iterator[None]:
    """Run a worker on a service's data."""
    with (server.settings.data_dir / "worker.log").open("ab") as log:
        worker = forked(
            "worker",
            env=environment(server.settings, **LOOPBACK),
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
    try:
        yield
    finally:
        worker.send_signal(signal.SIGTERM)
        worker.wait(timeout=PATIENCE_S)
