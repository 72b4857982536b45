"""kill -9 at seeded random times of the service, the worker, its warm child or a job, while a story runs."""

from __future__ import annotations

import os
import random
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from sqlalchemy import func, select

from service.db.models import Drawing, Job, Revision
from service.settings import Settings
from tests.patience import PATIENCE_S, soon
from tests.server import start
from tests.worker.conftest import DATABASES, url_of
from tests.worker.test_worker_crashes import assert_whole
from tests.worker.workbench import Workbench, a_small_drawing, children_of, kill

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]

VICTIMS = ("service", "worker", "warm child", "job")


class Installation:
    """A service and a worker that are started again when they died."""

    def __init__(self, bench: Workbench, settings: Settings) -> None:
        self.bench, self.settings = bench, settings
        self.server = start(settings)
        self.key = self.server.admin_key
        self.worker = self.start_worker()

    def start_worker(self) -> Any:
        """Return a worker with a short lease, so that a lost job is soon taken over."""
        return self.bench.start_worker(lease_s="2", beat_s="0.2")

    def kill(self, victim: str) -> bool:
        """Kill the victim, start again what does not start by itself, and tell whether there was one."""
        if victim == "service":
            self.server.process.kill()
            self.server.process.wait()
            old, self.server = self.server, start(self.settings, admin_key=self.key)
            old.close()
            return True
        if victim == "worker":
            kill(self.worker)
            self.worker = self.start_worker()
            return True
        warm = children_of(self.worker.pid)
        pids = warm if victim == "warm child" else [pid for w in warm for pid in children_of(w)]
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
        return bool(pids)

    def ask(self, method: str, path: str, **told: Any) -> dict[str, Any]:
        """Return the answer, asking again for as long as there is none, as a client with patience does."""
        until = time.monotonic() + PATIENCE_S
        while True:
            try:
                headers = {"Authorization": f"Bearer {self.key}"} | told.get("headers", {})
                answer = httpx.request(
                    method, self.server.url + path, timeout=20.0, **(told | {"headers": headers})
                )
            except httpx.TransportError:
                assert time.monotonic() < until, path
                time.sleep(0.1)
                continue
            if answer.status_code == 503:
                time.sleep(0.2)
                continue
            assert answer.status_code < 300, (path, answer.text)
            found: dict[str, Any] = answer.json()
            return found

    def finished(self, job: dict[str, Any]) -> None:
        """Wait until the job has succeeded."""

        def succeeded() -> bool:
            state = self.ask("GET", f"/v1/jobs/{job['id']}")["state"]
            assert state in {"queued", "running", "succeeded"}, job
            return bool(state == "succeeded")

        soon(succeeded, f"{job['id']} never ended")

    def close(self) -> None:
        """Stop both."""
        kill(self.worker)
        self.server.close()


def story(installation: Installation, map_id: str, picture: bytes, number: int) -> None:
    """Upload a drawing, and build a revision from its reading."""
    said = installation.ask(
        "POST",
        f"/v1/maps/{map_id}/drawings",
        files={"file": ("plan.png", picture)},
        data={"metres_per_unit": "0.05"},
        headers={"Idempotency-Key": f"drawing-{number}"},
    )
    installation.finished(said["job"])
    made = installation.ask(
        "POST",
        f"/v1/maps/{map_id}/revisions",
        json={"drawing_id": said["drawing"]["id"], "recipe": {"voxel_size_m": 0.2}},
        headers={"Idempotency-Key": f"revision-{number}"},
    )
    assert made["revision"]["n"] == number
    installation.finished(made["job"])


@pytest.fixture(params=DATABASES)
def installation(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Installation]:
    """Give a running service and worker on each database."""
    url = url_of(request.param, request, tmp_path)
    bench = Workbench(tmp_path / "data", url)
    made = Installation(bench, Settings(data_dir=tmp_path / "data", database_url=url))
    yield made
    made.close()
    bench.close()


@pytest.mark.parametrize(
    "kills", [pytest.param(6, id="6-kills"), pytest.param(50, id="50-kills", marks=pytest.mark.crash)]
)
def test_kills_at_random_times_leave_one_revision_for_each_request(
    installation: Installation, tmp_path: Path, kills: int
) -> None:
    seeded = random.Random(20_260_101)
    picture = a_small_drawing(tmp_path / "plan.png").read_bytes()
    map_id = installation.ask("POST", "/v1/maps", json={"site": "works", "name": "hall"})["id"]
    story(installation, map_id, picture, 1)
    for number in range(2, kills + 2):
        victim, after_s = VICTIMS[number % len(VICTIMS)], seeded.uniform(0.0, 1.2)
        failures: list[BaseException] = []

        def tell() -> None:
            try:
                story(installation, map_id, picture, number)  # noqa: B023
            except BaseException as error:  # noqa: BLE001
                failures.append(error)  # noqa: B023

        begun = time.monotonic()
        client = threading.Thread(target=tell)
        client.start()
        time.sleep(after_s)
        hit = installation.kill(victim)
        client.join()
        print(  # noqa: T201 - the table of kills and outcomes
            f"{number - 1:3} {victim:11} after {after_s:4.2f} s"
            f" {'' if hit else '(none ran)':10} {time.monotonic() - begun:6.1f} s"
        )
        assert not failures, failures
    assert_whole(installation.bench)
    with installation.bench.kernel.db.reading() as session:
        assert session.scalar(select(func.count()).select_from(Revision)) == kills + 1
        assert session.scalar(select(func.count()).select_from(Drawing)) == kills + 1
        assert session.scalar(select(func.count()).where(Job.state == "succeeded")) == 2 * (kills + 1)
        assert set(session.scalars(select(Revision.status))) == {"ready"}
