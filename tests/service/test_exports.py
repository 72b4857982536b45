"""Exports over HTTP: asked for once, waited for, fetched as any file."""

from __future__ import annotations

import hashlib

import httpx

from service.usecases.exports import record_export
from tests.server import ClientFor
from tests.service.asking import a_map, a_ready_revision, ok, refused
from tests.service.by_hand import ByHand


def test_an_export_is_asked_for_waited_for_and_fetched(
    admin: httpx.Client, client_for: ClientFor, by_hand: ByHand
) -> None:
    map_id = a_map(admin)
    n = a_ready_revision(admin, by_hand, map_id)
    where = f"/v1/maps/{map_id}/revisions/{n}/exports"
    tablet, robot = client_for("tablet", [map_id]), client_for("robot", [map_id])
    refused(robot.post(where, json={"format": "laz"}), 403, "forbidden")
    refused(admin.post(where, json={"format": "e57"}), 422, "invalid-request")
    refused(admin.get(f"{where}/laz"), 404, "artifact-not-found")
    refused(client_for("tablet", [a_map(admin)]).post(where, json={"format": "laz"}), 404, "map-not-found")
    asked = ok(tablet.post(where, json={"format": "laz"}), 202)
    again = ok(admin.post(where, json={"format": "laz"}), 202)
    assert (again["job"]["id"], again["export"]["id"]) == (asked["job"]["id"], asked["export"]["id"])
    assert asked["job"]["kind"] == "export-cloud"
    waiting = admin.get(f"{where}/laz")
    assert refused(waiting, 503, "export-not-ready")["job_id"] == asked["job"]["id"]
    assert waiting.headers["retry-after"] == "1"
    content = b"stands in for a LAZ file" * 100
    attempt = by_hand.claim(asked["job"]["id"])
    with by_hand.kernel.db.writing("record-export") as session:
        record_export(by_hand.kernel, session, attempt, stored=by_hand.keep(content))
    sha256 = hashlib.sha256(content).hexdigest()
    made = robot.get(f"{where}/laz")
    assert (made.content, made.headers["etag"]) == (content, f'"{sha256}"')
    part = robot.get(f"{where}/laz", headers={"Range": "bytes=5-9", "If-Range": f'"{sha256}"'})
    assert (part.status_code, part.content) == (206, content[5:10])
    assert ok(admin.post(where, json={"format": "laz"}), 202)["export"]["sha256"] == sha256
    refused(admin.get(f"{where}/ply"), 404, "artifact-not-found")
    other = ok(admin.post(where, json={"format": "ply"}), 202)
    by_hand.fail(other["job"]["id"], problem={"slug": "job-crashed", "title": "t", "detail": "d"})
    failed = admin.get(f"{where}/ply")
    refused(failed, 503, "export-not-ready")
    assert failed.headers["retry-after"] == "3600"
