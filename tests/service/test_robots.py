"""Robots: enrolled with a key of their own, heard, and followed until they run what they should."""

from __future__ import annotations

from typing import Any

import httpx
import pytest

from tests.server import ClientFor, Server
from tests.service.asking import a_map, a_ready_revision, ok, refused
from tests.service.by_hand import ByHand


def enrol(admin: httpx.Client, map_id: str, **more: Any) -> dict[str, Any]:
    return ok(admin.post("/v1/robots", json={"name": "AMR", "map_id": map_id, **more}), 201)


def say(robot: httpx.Client, robot_id: str, revision: int, state: str, **more: Any) -> dict[str, Any]:
    body = {"revision": revision, "state": state, **more}
    return ok(robot.post(f"/v1/robots/{robot_id}/reports", json=body), 201)


def _story(server: Server) -> None:
    admin, by_hand = server.client(server.admin_key), ByHand(server.kernel)
    map_id = a_map(admin)
    made = enrol(admin, map_id, group="night-shift")
    robot, me = server.client(made["key"]), made["id"]
    assert (made["progress"], made["behind"], made["wanted_revision"]) == ("nothing-published", False, None)
    first, second = (a_ready_revision(admin, by_hand, map_id) for _ in range(2))

    def publish(n: int, channel: str = "stable") -> None:
        ok(admin.post(f"/v1/maps/{map_id}/revisions/{n}/publish", json={"channel": channel}))

    def seen() -> tuple[str, bool, int | None, int | None]:
        told = ok(robot.get(f"/v1/robots/{me}"))
        listed = ok(admin.get("/v1/robots", params={"map": map_id}))["items"]
        assert listed == [told]
        behind = ok(admin.get("/v1/robots", params={"map": map_id, "behind": told["behind"]}))["items"]
        assert behind == [told]
        others = ok(admin.get("/v1/robots", params={"map": map_id, "behind": not told["behind"]}))
        assert others["items"] == []
        return told["progress"], told["behind"], told["wanted_revision"], told["enabled_revision"]

    publish(first)
    assert seen() == ("never-reported", True, first, None)
    say(robot, me, first, "downloaded")
    say(robot, me, first, "verified", sha256="ab" * 32)
    assert seen() == ("not-enabled", True, first, None)
    say(robot, me, first, "enabled")
    assert seen() == ("up-to-date", False, first, first)
    publish(second)
    assert seen() == ("not-begun", True, second, first)
    failed = say(robot, me, second, "failed", detail="disk full")
    assert (failed["state"], failed["detail"], failed["reported_revision"]) == ("failed", "disk full", second)
    assert seen() == ("failed", True, second, first)
    ok(admin.patch(f"/v1/robots/{me}", json={"channel": "canary"}))
    assert seen() == ("nothing-published", False, None, first)
    publish(first, "canary")
    assert seen() == ("up-to-date", False, first, first)
    reports = ok(robot.get(f"/v1/robots/{me}/reports", params={"limit": 3}))
    assert [r["state"] for r in reports["items"]] == ["failed", "enabled", "verified"]
    rest = ok(robot.get(f"/v1/robots/{me}/reports", params={"limit": 3, "cursor": reports["next_cursor"]}))
    assert [r["state"] for r in rest["items"]] == ["downloaded"]


def test_a_robots_way_is_seen_on_sqlite(server: Server) -> None:
    _story(server)


@pytest.mark.postgres
def test_a_robots_way_is_seen_on_postgresql(postgres_served: Server) -> None:
    _story(postgres_served)


def test_a_robots_key_covers_its_map_and_speaks_for_it_alone(
    server: Server, admin: httpx.Client, by_hand: ByHand
) -> None:
    map_id = a_map(admin)
    a_ready_revision(admin, by_hand, map_id)
    one, two = enrol(admin, map_id), enrol(admin, map_id)
    robot = server.client(one["key"])
    ok(robot.get(f"/v1/maps/{map_id}"))
    refused(robot.get(f"/v1/maps/{a_map(admin)}"), 404, "map-not-found")
    body = {"revision": 1, "state": "enabled"}
    refused(robot.post(f"/v1/robots/{two['id']}/reports", json=body), 403, "forbidden")
    refused(robot.get(f"/v1/robots/{two['id']}"), 403, "forbidden")
    refused(robot.get("/v1/robots"), 403, "forbidden")
    where = f"/v1/robots/{one['id']}/reports"
    refused(robot.post(where, json={"revision": 99, "state": "enabled"}), 404, "revision-not-found")
    refused(robot.post(where, json={"revision": 1, "state": "lost"}), 422, "invalid-request")
    refused(robot.post("/v1/robots/rob_none/reports", json=body), 404, "robot-not-found")
    assert admin.delete(f"/v1/keys/{one['key_id']}").status_code == 204
    refused(robot.post(where, json=body), 401, "unauthenticated")


def test_enrolling_twice_with_one_name_for_the_request_makes_one_robot(admin: httpx.Client) -> None:
    map_id = a_map(admin)
    again = {"Idempotency-Key": "enrol-amr-7"}
    body = {"name": "AMR 7", "map_id": map_id}
    first, second = (ok(admin.post("/v1/robots", json=body, headers=again), 201) for _ in range(2))
    assert first == second
    assert first["key"].startswith("gp_")
    assert len(ok(admin.get("/v1/robots", params={"map": map_id}))["items"]) == 1


def test_robots_are_found_by_channel_and_group(admin: httpx.Client, client_for: ClientFor) -> None:
    map_id, other = a_map(admin), a_map(admin)
    wanted = enrol(admin, map_id, channel="canary", group="dock")
    for more in ({"channel": "canary"}, {"group": "dock"}, {}):
        enrol(admin, map_id, **more)
    asked = {"map": map_id, "channel": "canary", "group": "dock"}
    found = ok(admin.get("/v1/robots", params=asked))["items"]
    assert [robot["id"] for robot in found] == [wanted["id"]]
    page = ok(admin.get("/v1/robots", params={"map": map_id, "limit": 3}))
    last = ok(admin.get("/v1/robots", params={"map": map_id, "limit": 3, "cursor": page["next_cursor"]}))
    assert len(page["items"] + last["items"]) == 4
    tablet = client_for("tablet", [other])
    assert ok(tablet.get("/v1/robots"))["items"] == []
    gone = ok(admin.patch(f"/v1/robots/{wanted['id']}", json={"group": None, "name": "renamed"}))
    assert (gone["group"], gone["name"], gone["channel"]) == (None, "renamed", "canary")
