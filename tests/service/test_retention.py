"""Old revisions let their files go, never what a channel, a robot or a job needs; and come back the same."""

from __future__ import annotations

from pathlib import Path

import httpx
import pytest

from service.db.models import Artifact, Blob
from service.settings import Settings
from service.usecases.prune_revisions import prune_revisions
from service.usecases.rebuild import record_rebuild
from tests.server import Server, running, start
from tests.service.asking import a_map, ok, refused
from tests.service.by_hand import PICTURE, ByHand
from tests.service.halls import make_delta


def a_cloud(client: httpx.Client, by_hand: ByHand, map_id: str, content: bytes) -> int:
    """Return the number of a new ready revision with this cloud."""
    made = ok(client.post(f"/v1/maps/{map_id}/revisions", json={"drawing_id": by_hand.drawing(map_id)}), 202)
    by_hand.build(made["job"]["id"], cloud=content)
    n: int = made["revision"]["n"]
    return n


def kept(client: httpx.Client, map_id: str) -> list[int]:
    """Return the revisions whose files are there."""
    listed = ok(client.get(f"/v1/maps/{map_id}/revisions", params={"limit": 200}))["items"]
    return sorted(one["n"] for one in listed if one["pruned_at"] is None)


def blobs(server: Server) -> set[str]:
    with server.kernel.db.reading() as session:
        return {row.sha256 for row in session.query(Blob)}


def _story(server: Server) -> None:
    admin, by_hand = server.client(server.admin_key), ByHand(server.kernel)
    map_id = a_map(admin)
    for k in range(8):
        a_cloud(admin, by_hand, map_id, b"cloud %d" % k)

    def publish(n: int) -> None:
        ok(admin.post(f"/v1/maps/{map_id}/revisions/{n}/publish", json={}))

    publish(2)
    publish(4)
    made = ok(admin.post("/v1/robots", json={"name": "AMR", "map_id": map_id}), 201)
    robot = server.client(made["key"])
    ok(robot.post(f"/v1/robots/{made['id']}/reports", json={"revision": 1, "state": "enabled"}), 201)
    scan = by_hand.scan(map_id)
    asked = ok(admin.post(f"/v1/scans/{scan}/placements", json={"revision": 5}), 202)
    before = blobs(server)
    assert prune_revisions(server.kernel, keep=2) == 2
    assert kept(admin, map_id) == [1, 2, 4, 5, 7, 8], (
        "a robot's, two of the channel, a placement's, the newest"
    )
    assert len(before - blobs(server)) == 2, (
        "their clouds alone: the other files are those of other revisions"
    )
    assert prune_revisions(server.kernel, keep=2) == 0
    by_hand.place(asked["job"]["id"])
    assert prune_revisions(server.kernel, keep=2) == 1
    assert prune_revisions(server.kernel, keep=0) == 0

    where = f"/v1/maps/{map_id}/revisions/3"
    for path in ("artifacts", "artifacts/point-cloud.pcd", "delta?from=8", "compare?with=8"):
        assert "/rebuild" in refused(admin.get(f"{where}/{path}"), 409, "revision-pruned")["detail"]
    refused(admin.get(f"/v1/maps/{map_id}/revisions/8/delta?from=3"), 409, "revision-pruned")
    refused(admin.post(f"{where}/publish", json={}), 409, "revision-pruned")
    shown = ok(admin.get(where))
    assert (shown["status"], shown["layers"], shown["pruned_at"] is None) == ("ready", [], False)

    files = {"point-cloud.pcd": b"cloud 2", "preview.png": PICTURE, "report.json": b"{}"}
    job = ok(admin.post(f"{where}/rebuild"), 202)
    attempt = by_hand.claim(job["id"])
    stored = {path: by_hand.keep(content) for path, content in files.items()}
    with server.kernel.db.writing("record-rebuild") as session:
        record_rebuild(server.kernel, session, attempt, version="by hand", files=stored)
    assert admin.get(f"{where}/artifacts/point-cloud.pcd").content == b"cloud 2"
    assert 3 in kept(admin, map_id)
    actions = [e["action"] for e in ok(admin.get("/v1/audit", params={"map": map_id}))["items"]]
    assert actions.count("prune-revision") == 3
    assert actions.count("rebuild-revision") == 1


def _waiting_jobs(server: Server, folder: Path) -> None:
    """Whatever a waiting job reads stays until it has ended, and every such job ends well."""
    admin, by_hand = server.client(server.admin_key), ByHand(server.kernel)
    map_id = a_map(admin)
    for k in range(7):
        a_cloud(admin, by_hand, map_id, b"cloud %d of %s" % (k, map_id.encode()))
    where = f"/v1/maps/{map_id}/revisions"
    asked = [
        refused(admin.get(f"{where}/2/delta?from=1"), 503, "delta-not-ready")["job_id"],
        ok(admin.get(f"{where}/4/compare?with=3"), 202)["job"]["id"],
        ok(admin.post(f"{where}/5/exports", json={"format": "ply"}), 202)["job"]["id"],
    ]
    assert prune_revisions(server.kernel, keep=1) == 1
    assert kept(admin, map_id) == [1, 2, 3, 4, 5, 7]
    make_delta(by_hand, asked[0], folder)
    for job_id in asked[1:]:
        ok(admin.post(f"/v1/jobs/{job_id}/cancel"), 202)
    assert prune_revisions(server.kernel, keep=1) == 5
    assert kept(admin, map_id) == [7]


def test_what_a_waiting_job_reads_stays(server: Server, tmp_path: Path) -> None:
    _waiting_jobs(server, tmp_path)


@pytest.mark.postgres
def test_what_a_waiting_job_reads_stays_on_postgresql(postgres_served: Server, tmp_path: Path) -> None:
    _waiting_jobs(postgres_served, tmp_path)


def test_what_nothing_needs_is_let_go_and_comes_back(server: Server) -> None:
    _story(server)


@pytest.mark.postgres
def test_what_nothing_needs_is_let_go_and_comes_back_on_postgresql(postgres_served: Server) -> None:
    _story(postgres_served)


def test_the_service_prunes_by_itself_and_a_kill_in_between_leaves_all_or_nothing(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "data")
    with running(settings) as server:
        admin, by_hand = server.client(server.admin_key), ByHand(server.kernel)
        map_id = a_map(admin)
        for k in range(4):
            a_cloud(admin, by_hand, map_id, b"cloud %d" % k)
        key = server.admin_key
    for when, left in (("before", 4), ("after", 1)):
        point = f"prune-revisions.{when}-commit"
        dying = start(settings, admin_key=key, GROUNDPLAN_KEEP_REVISIONS="1", GROUNDPLAN_CRASH_AT=point)
        try:
            dying.process.wait(30)
            with dying.kernel.db.reading() as session:
                clouds = session.query(Artifact).filter_by(path="point-cloud.pcd").count()
            assert clouds == left, when
        finally:
            dying.close()
