"""kill -9 of the service at each of its crash points; the client sends the same request again."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
from sqlalchemy import func, select

from service.crash_points import CRASH_POINTS
from service.db.comparisons import Comparison
from service.db.deltas import Delta
from service.db.models import (
    Blob,
    Drawing,
    Job,
    Key,
    Map,
    Placement,
    Publication,
    Revision,
    Scan,
    Upload,
)
from service.db.proposals import Proposal
from service.db.robots import Robot, RobotReport
from service.settings import Settings
from service.usecases.proposals import propose
from tests import files
from tests.patience import PATIENCE_S
from tests.server import start
from tests.service.asking import a_map, a_placement, a_ready_revision
from tests.service.by_hand import ByHand
from tests.service.tus_client import PIECE, TUS, metadata
from tests.worker.conftest import DATABASES, url_of
from tests.worker.test_worker_crashes import POINTS as POINTS_OF_THE_WORKER

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

PNG = files.png()
PLY = files.ply(files.room())
AT_START = {"create-first-key", "forget-answers", "sweep-uploads"}
TABLES = (
    Map,
    Key,
    Drawing,
    Scan,
    Placement,
    Revision,
    Publication,
    Job,
    Upload,
    Delta,
    Comparison,
    Robot,
    RobotReport,
)

Request = tuple[str, str, dict[str, Any]]


class Service:
    """A service that is started again when it died, and what its clients need to know."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.server = start(settings, GROUNDPLAN_CRASH_AT="@crash-at")
        self.key = self.server.admin_key
        self.order = settings.data_dir / "crash-at"
        self.by_hand = ByHand(self.server.kernel)
        self.map_id = a_map(self.client)

    @property
    def client(self) -> httpx.Client:
        """Return a client of the running service."""
        return self.server.client(self.key)

    def restart(self) -> None:
        """Start the service anew, wherever it stands."""
        self.server.process.kill()
        self.server.close()
        self.server = start(self.settings, admin_key=self.key, GROUNDPLAN_CRASH_AT="@crash-at")
        self.by_hand = ByHand(self.server.kernel)

    def counts(self) -> dict[str, int]:
        """Return how many rows each table has."""
        with self.server.kernel.db.reading() as session:
            counted = {t.__tablename__: session.scalar(select(func.count()).select_from(t)) for t in TABLES}
        return {name: count or 0 for name, count in counted.items()}

    def request_for(self, point: str) -> Request:
        """Return the request that passes the point, everything that it needs being there."""
        name, client, map_id = point.partition(".")[0], self.client, self.map_id
        drawing: Callable[[], str] = lambda: self.by_hand.drawing(map_id)  # noqa: E731
        made: dict[str, Callable[[], Request]] = {
            "create-key": lambda: ("POST", "/v1/keys", {"json": {"name": "t", "role": "tablet"}}),
            "revoke-key": lambda: ("DELETE", f"/v1/keys/{self.new_key()}", {}),
            "create-map": lambda: ("POST", "/v1/maps", {"json": {"site": "S", "name": point}}),
            "change-map": lambda: ("PATCH", f"/v1/maps/{map_id}", {"json": {"name": point}}),
            "revise": lambda: ("POST", f"/v1/maps/{map_id}/revisions", {"json": {"drawing_id": drawing()}}),
            "place-scan": lambda: (
                "POST",
                f"/v1/scans/{self.by_hand.scan(map_id)}/placements",
                {"json": {"rough_pose": {"x_m": 1.0, "y_m": 2.0}}},
            ),
            "accept-placement": lambda: (
                "POST",
                f"/v1/placements/{a_placement(client, self.by_hand, map_id)}/accept",
                {"json": {}},
            ),
            "publish": lambda: (
                "POST",
                f"/v1/maps/{map_id}/revisions/{a_ready_revision(client, self.by_hand, map_id)}/publish",
                {"json": {"channel": "stable"}},
            ),
            "ask-delta": lambda: (
                "GET",
                f"/v1/maps/{map_id}/revisions/{self.new_cloud(point)}/delta?from=1",
                {},
            ),
            "ask-comparison": lambda: (
                "GET",
                f"/v1/maps/{map_id}/revisions/{self.new_cloud(point)}/compare?with=1",
                {},
            ),
            "rebuild-revision": lambda: ("POST", f"/v1/maps/{map_id}/revisions/1/rebuild", {}),
            "decide-proposal": lambda: ("POST", f"/v1/proposals/{self.new_proposal()}/dismiss", {}),
            "enrol-robot": lambda: ("POST", "/v1/robots", {"json": {"name": "r", "map_id": map_id}}),
            "change-robot": lambda: ("PATCH", f"/v1/robots/{self.new_robot()}", {"json": {"name": point}}),
            "take-report": lambda: (
                "POST",
                f"/v1/robots/{self.new_robot()}/reports",
                {"json": {"revision": 1, "state": "enabled"}},
            ),
            "cancel-job": lambda: ("POST", f"/v1/jobs/{self.queued_job()}/cancel", {}),
            "retry-job": lambda: ("POST", f"/v1/jobs/{self.failed_job()}/retry", {}),
            "receive-scan": lambda: (
                "POST",
                f"/v1/maps/{map_id}/scans",
                {"files": {"file": ("room.ply", PLY + point.encode())}},
            ),
            "reread-drawing": lambda: (
                "PATCH",
                f"/v1/drawings/{drawing()}",
                {"json": {"scale": {"metres_per_unit": 0.03}}},
            ),
            "create-upload": lambda: ("POST", "/v1/tus", {"headers": self.tus_told()}),
            "finish-upload": self.whole_piece,
            "upload": self.whole_piece,
            "terminate-upload": lambda: ("DELETE", self.begun_upload(), {"headers": TUS}),
        }
        upload: Callable[[], Request] = lambda: (  # noqa: E731
            "POST",
            f"/v1/maps/{map_id}/drawings",
            {"files": {"file": ("plan.png", PNG)}, "data": {"metres_per_unit": "0.05"}},
        )
        return made.get(name, upload)()

    def new_cloud(self, content: str) -> int:
        """Return the number of a new ready revision whose cloud is like no other."""
        body = {"drawing_id": self.by_hand.drawing(self.map_id)}
        made = self.client.post(f"/v1/maps/{self.map_id}/revisions", json=body).json()
        self.by_hand.build(made["job"]["id"], cloud=content.encode())
        n: int = made["revision"]["n"]
        return n

    def new_proposal(self) -> str:
        """Return the id of an open proposal."""
        placement_id = a_placement(self.client, self.by_hand, self.map_id)
        kernel = self.server.kernel
        with kernel.db.writing("record-placement") as session:
            placement = session.get_one(Placement, placement_id)
            propose(kernel, session, placement, [{"layer_id": "lyr_1"}])
        with kernel.db.reading() as session:
            return session.scalars(select(Proposal.id).where(Proposal.placement_id == placement_id)).one()

    def new_robot(self) -> str:
        """Return the id of a new robot."""
        made = self.client.post("/v1/robots", json={"name": "r", "map_id": self.map_id})
        robot_id: str = made.json()["id"]
        return robot_id

    def new_key(self) -> str:
        """Return the id of a new key."""
        made = self.client.post("/v1/keys", json={"name": "old", "role": "robot"})
        key_id: str = made.json()["id"]
        return key_id

    def queued_job(self) -> str:
        """Return a job that waits."""
        drawing_id = self.by_hand.drawing(self.map_id, read=False)
        with self.server.kernel.db.reading() as session:
            return session.get_one(Drawing, drawing_id).job_id

    def failed_job(self) -> str:
        """Return a job that failed."""
        job_id = self.queued_job()
        self.by_hand.fail(job_id, problem={"slug": "file-malformed", "title": "t", "detail": "d"})
        return job_id

    def tus_told(self) -> dict[str, str]:
        """Return the headers that create an upload."""
        said = metadata(map_id=self.map_id, kind="scan", filename="room.ply")
        return TUS | {"Upload-Length": str(len(PLY)), "Upload-Metadata": said}

    def begun_upload(self) -> str:
        """Return the path of an upload that has no byte yet."""
        location = self.client.post("/v1/tus", headers=self.tus_told()).headers["location"]
        return httpx.URL(location).path

    def whole_piece(self) -> Request:
        """Return the request that sends a whole upload in one piece."""
        return "PATCH", self.begun_upload(), {"headers": PIECE | {"Upload-Offset": "0"}, "content": PLY}

    def ask(self, request: Request, key: str) -> httpx.Response | None:
        """Return the answer, or None when the service died before it gave one."""
        method, path, told = request
        headers = told.get("headers", {}) | {"Idempotency-Key": key}
        try:
            return self.client.request(method, path, **(told | {"headers": headers}))
        except httpx.TransportError:
            return None

    def settle(self) -> None:
        """End builds and jobs that wait, so that the next request finds the map free."""
        with self.server.kernel.db.reading() as session:
            building = list(session.scalars(select(Revision.job_id).where(Revision.status == "building")))
        for job_id in building:
            self.by_hand.build(job_id)


@dataclass
class Outcome:
    """Hold what came of one crash."""

    point: str
    first: str
    second: str
    new_rows: dict[str, int]

    def __str__(self) -> str:
        """Return a line of the table."""
        return f"{self.point:34} {self.first:10} {self.second:6} {self.new_rows}"


NEW = {
    "create-key": {"keys": 1},
    "create-map": {"maps": 1},
    "revise": {"revisions": 1, "jobs": 1},
    "place-scan": {"placements": 1, "jobs": 1},
    "accept-placement": {"revisions": 1, "jobs": 1},
    "publish": {"publications": 1},
    "ask-delta": {"deltas": 1, "jobs": 1},
    "ask-comparison": {"comparisons": 1, "jobs": 1},
    "rebuild-revision": {"jobs": 1},
    "enrol-robot": {"robots": 1, "keys": 1},
    "take-report": {"robot_reports": 1},
    "receive-drawing": {"drawings": 1, "jobs": 1},
    "receive-scan": {"scans": 1, "jobs": 1},
    "reread-drawing": {"jobs": 1},
    "reread-drawing.after-commit": {"jobs": 2},  # a PATCH is no POST: the second cancels the first's job
    "blob": {"drawings": 1, "jobs": 1},
    "create-upload": {"uploads": 1},
    "finish-upload": {"scans": 1, "jobs": 1},
    "upload": {"scans": 1, "jobs": 1},
    "terminate-upload": {"uploads": -1},
}
STATUS = {
    "revoke-key": {204, 404},
    "ask-delta": {503},
    "terminate-upload": {204, 404},
    "finish-upload": {204, 409},
    "upload": {204, 409},
}
ELSEWHERE = (
    "create-first-key",
    "prune-revisions",
    "hold-bridge-lease",
    "end-bridge-lease",
    "remark-on-robot",
)
"""Tried by tests of their own: the last test here, in test_retention.py and in test_vda5050_faults.py."""
POINTS = sorted(
    p
    for p in CRASH_POINTS
    if p.startswith("blob.") or (p not in POINTS_OF_THE_WORKER and not p.startswith(ELSEWHERE))
)


def test_every_crash_point_is_tried() -> None:
    elsewhere = {p for p in CRASH_POINTS if p.startswith(ELSEWHERE)}
    assert set(POINTS) | set(POINTS_OF_THE_WORKER) | elsewhere == CRASH_POINTS


@pytest.fixture(params=DATABASES)
def service(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Service]:
    url = None if request.param == "sqlite" else url_of(request.param, request, tmp_path)
    running = Service(Settings(data_dir=tmp_path / "data", database_url=url))
    yield running
    running.server.close()


def crash(service: Service, point: str) -> Outcome:
    """Let the service die at the point, send the request again, and tell what has become of it."""
    name = point.partition(".")[0]
    if name in AT_START:
        before = service.counts()
        service.order.write_text(point, encoding="ascii")
        _restart_until_obeyed(service)
        return Outcome(point, "died", "-", _difference(before, service.counts()))
    request = service.request_for(point)
    before = service.counts()
    service.order.write_text(point, encoding="ascii")
    first = service.ask(request, point)
    assert not service.order.exists(), f"{point} was not reached: {first and first.text}"
    service.restart()
    second = service.ask(_resumed(service, request), point)
    assert second is not None
    allowed = STATUS.get(name, {200, 201, 202})
    assert second.status_code in allowed, (point, second.text)
    outcome = Outcome(
        point, "no answer" if first is None else str(first.status_code), str(second.status_code), {}
    )
    outcome.new_rows = _difference(before, service.counts())
    service.settle()
    return outcome


def _resumed(service: Service, request: Request) -> Request:
    """Return the request as a client repeats it: an upload in pieces goes on from the stored offset."""
    method, path, _told = request
    if method != "PATCH" or not path.startswith("/v1/tus"):
        return request
    answer = service.client.head(path, headers=TUS)
    at = int(answer.headers["upload-offset"])
    return method, path, {"headers": PIECE | {"Upload-Offset": str(at)}, "content": PLY[at:]}


def _restart_until_obeyed(service: Service) -> None:
    """Start the service until it has died of its order, and once more."""
    until = time.monotonic() + PATIENCE_S
    while service.order.exists():
        assert time.monotonic() < until
        service.restart()
        time.sleep(0.5)
    service.restart()


def _difference(before: dict[str, int], after: dict[str, int]) -> dict[str, int]:
    return {name: after[name] - before[name] for name in after if after[name] != before[name]}


SAMPLE = [
    "blob.before-rename",
    "ask-comparison.after-commit",
    "ask-delta.after-commit",
    "create-map.after-commit",
    "enrol-robot.after-commit",
    "finish-upload.before-commit",
    "receive-drawing.after-commit",
    "receive-drawing.before-commit",
    "revise.after-commit",
    "take-report.after-commit",
]


@pytest.mark.parametrize(
    "points", [pytest.param(SAMPLE, id="some"), pytest.param(POINTS, id="all", marks=pytest.mark.crash)]
)
def test_a_kill_at_each_point_loses_nothing_and_does_nothing_twice(
    service: Service, points: list[str]
) -> None:
    a_ready_revision(service.client, service.by_hand, service.map_id)
    for point in points:
        outcome = crash(service, point)
        print(outcome)  # noqa: T201 - the table of points and outcomes
        assert outcome.new_rows == NEW.get(point, NEW.get(point.partition(".")[0], {})), outcome
    with service.server.kernel.db.reading() as session:
        for blob in session.scalars(select(Blob)):
            assert service.server.kernel.blobs.exists(blob.sha256)


@pytest.mark.parametrize("when", ["before-commit", "after-commit"])
def test_a_kill_while_the_first_key_is_made_leaves_at_most_one(tmp_path: Path, when: str) -> None:
    settings = Settings(data_dir=tmp_path / "data")
    with pytest.raises(RuntimeError):
        start(settings, GROUNDPLAN_CRASH_AT=f"create-first-key.{when}")
    server = start(settings, admin_key="none" if when == "after-commit" else None)
    try:
        with server.kernel.db.reading() as session:
            assert session.scalar(select(func.count()).select_from(Key)) == 1
    finally:
        server.close()
