"""The pointer that robots poll."""

from __future__ import annotations

import threading

import httpx

from service.domain.findings import Finding
from tests.server import ClientFor, Server, new_client
from tests.service.asking import a_map, a_ready_revision, ok, refused
from tests.service.by_hand import ByHand


def test_a_robot_polls_and_is_told_what_changed(
    admin: httpx.Client, by_hand: ByHand, client_for: ClientFor
) -> None:
    map_id = a_map(admin)
    robot = client_for("robot", [map_id])
    where = f"/v1/maps/{map_id}/published"
    refused(robot.get(where), 404, "nothing-published")
    first, second = (a_ready_revision(admin, by_hand, map_id) for _ in range(2))
    answer = admin.post(f"/v1/maps/{map_id}/revisions/{first}/publish", json={"channel": "stable"})
    told = robot.get(where, params={"channel": "stable"})
    assert ok(told) == ok(answer)
    assert told.headers["etag"] == answer.headers["etag"]
    assert told.json()["revision"] == first
    for file in told.json()["artifacts"]:
        got = robot.get(file["url"])
        assert (got.headers["etag"], len(got.content)) == (f'"{file["sha256"]}"', file["size_bytes"])
    etag = told.headers["etag"]
    for header in (etag, f"W/{etag}", f'"x", {etag}', "*"):
        unchanged = robot.get(where, headers={"If-None-Match": header})
        assert (unchanged.status_code, unchanged.content, unchanged.headers["etag"]) == (304, b"", etag)
    ok(admin.post(f"/v1/maps/{map_id}/revisions/{second}/publish", json={}))
    moved = robot.get(where, headers={"If-None-Match": etag})
    assert (ok(moved)["revision"], moved.headers["etag"] != etag) == (second, True)
    back = admin.post(f"/v1/maps/{map_id}/revisions/{first}/publish", json={})
    assert ok(back)["revision"] == first
    assert back.headers["etag"] not in {etag, moved.headers["etag"]}
    assert robot.head(where).headers["etag"] == back.headers["etag"]
    now = back.headers["etag"]
    for held in ({}, {"If-None-Match": now}):
        gone = robot.get(where, headers={"If-Match": moved.headers["etag"], **held})
        assert refused(gone, 412, "pointer-moved")["revision"] == first
    assert ok(robot.get(where, headers={"If-Match": f'"x", {now}'}))["revision"] == first
    assert robot.get(where, headers={"If-Match": now, "If-None-Match": now}).status_code == 304


def test_publishing_what_is_published_changes_nothing(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id = a_map(admin)
    n = a_ready_revision(admin, by_hand, map_id)
    where = f"/v1/maps/{map_id}/revisions/{n}/publish"
    first, second = admin.post(where, json={}), admin.post(where, json={})
    assert (ok(first), first.headers["etag"]) == (ok(second), second.headers["etag"])


def test_if_match_guards_the_pointer(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id = a_map(admin)
    for _ in range(2):
        a_ready_revision(admin, by_hand, map_id)
    one, two = (f"/v1/maps/{map_id}/revisions/{n}/publish" for n in (1, 2))
    refused(admin.post(one, json={}, headers={"If-Match": "*"}), 412, "pointer-moved")
    etag = admin.post(one, json={}).headers["etag"]
    moved = admin.post(two, json={}, headers={"If-Match": etag})
    ok(moved)
    late = refused(admin.post(one, json={}, headers={"If-Match": etag}), 412, "pointer-moved")
    assert late["revision"] == 2
    refused(
        admin.post(one, json={}, headers={"If-Match": f"W/{moved.headers['etag']}"}), 412, "pointer-moved"
    )
    ok(admin.post(one, json={}, headers={"If-Match": "*"}))


def test_channels_are_apart_and_only_ready_revisions_are_published(
    admin: httpx.Client, by_hand: ByHand
) -> None:
    map_id = a_map(admin)
    n = a_ready_revision(admin, by_hand, map_id)
    where = f"/v1/maps/{map_id}/revisions"
    ok(admin.post(f"{where}/{n}/publish", json={"channel": "canary"}))
    refused(admin.get(f"/v1/maps/{map_id}/published"), 404, "nothing-published")
    refused(admin.post(f"{where}/{n}/publish", json={"channel": "No such!"}), 422, "invalid-request")
    building = ok(admin.post(where, json={"base": n}), 202)["revision"]["n"]
    refused(admin.post(f"{where}/{building}/publish", json={}), 409, "revision-not-ready")
    refused(admin.post(f"{where}/99/publish", json={}), 404, "revision-not-found")
    refused(admin.post(f"{where}/0/publish", json={}), 422, "invalid-request")
    refused(admin.post(f"{where}/99999999999999999999/publish", json={}), 422, "invalid-request")


def _race(server: Server) -> None:
    """Of several moves that saw the same pointer exactly one happens."""
    admin = server.client(server.admin_key)
    map_id = a_map(admin)
    by_hand = ByHand(server.kernel)
    movers = 4
    for _ in range(movers + 1):
        a_ready_revision(admin, by_hand, map_id)
    etag = admin.post(f"/v1/maps/{map_id}/revisions/1/publish", json={}).headers["etag"]
    barrier = threading.Barrier(movers)
    statuses: list[int] = []

    def move(n: int, client: httpx.Client) -> None:
        barrier.wait()
        answer = client.post(f"/v1/maps/{map_id}/revisions/{n}/publish", json={}, headers={"If-Match": etag})
        statuses.append(answer.status_code)

    threads = [
        threading.Thread(target=move, args=(n, new_client(server, "admin"))) for n in range(2, 2 + movers)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(statuses) == [200, *[412] * (movers - 1)]


def test_one_of_several_moves_wins_on_sqlite(server: Server) -> None:
    _race(server)


def test_a_revision_without_its_picture_is_published_and_tells_of_it(
    admin: httpx.Client, by_hand: ByHand, client_for: ClientFor
) -> None:
    map_id, values = a_map(admin), {"files": ["preview.png"]}
    told = Finding("file-not-made", "warning", "It could not be made.", values).to_json()
    made = ok(admin.post(f"/v1/maps/{map_id}/revisions", json={"drawing_id": by_hand.drawing(map_id)}), 202)
    by_hand.build(made["job"]["id"], without={"preview.png": told})
    where = f"/v1/maps/{map_id}/revisions/1"
    assert (ok(admin.get(where))["status"], ok(admin.get(where))["report"]["findings"]) == ("ready", [told])
    refused(admin.get(f"{where}/artifacts/preview.png"), 404, "artifact-not-found")
    ok(admin.post(f"{where}/publish", json={}))
    robot = client_for("robot", [map_id])
    files = ok(robot.get(f"/v1/maps/{map_id}/published"))["artifacts"]
    assert "preview.png" not in {file["path"] for file in files}
    assert all(robot.get(file["url"]).status_code == 200 for file in files)
