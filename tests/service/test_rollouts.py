"""Staged roll-outs: who gets the revision when, how they go on, and what stops them."""

from __future__ import annotations

import math
import time

import httpx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.domain.rollout import Stage, bound_of, rank, takes
from tests.patience import soon
from tests.server import ClientFor, Server, start
from tests.service.asking import a_map, a_ready_revision, ok, refused
from tests.service.by_hand import ByHand
from tests.service.fleets import Fleet

CANARIES, TENTH, HALF, ALL = {"group": "canary"}, {"share": 0.1}, {"share": 0.5}, {"share": 1.0}


def _whole_way(server: Server) -> None:
    fleet = Fleet(server, robots=11, canaries=2)
    rollout = fleet.begin(CANARIES, TENTH, HALF, {**ALL, "threshold": 0.8}, channel="stable")
    begun = fleet.rollout(rollout)
    assert (begun["state"], begun["stage"], begun["taken"], begun["enabled"]) == ("running", 0, 2, 0)
    assert fleet.having(2) == fleet.robots[:2]
    listed = ok(fleet.admin.get(f"/v1/rollouts/{rollout}/robots", params={"behind": True}))["items"]
    assert [(r["id"], r["progress"], r["wanted_revision"]) for r in listed] == [
        (robot.id, "not-begun", 2) for robot in fleet.robots[:2]
    ]
    seen = [set(fleet.having(2))]
    for stage in (1, 2, 3):
        for robot in seen[-1].difference(*seen[:-1]):
            assert fleet.rollout(rollout)["stage"] == stage - 1
            robot.say("enabled", 2)
        fleet.until(rollout, stage=stage)
        seen.append(set(fleet.having(2)))
        assert seen[-1] >= seen[-2], "nobody loses the revision"
    ranked = sorted(fleet.robots, key=lambda robot: rank(rollout, robot.id))
    assert seen[1] == {*fleet.robots[:2], *ranked[: math.ceil(1.1)]}
    assert seen[2] == {*fleet.robots[:2], *ranked[: math.ceil(5.5)]}
    assert seen[3] == set(fleet.robots)
    missing = [robot for robot in ranked if robot not in seen[2]]
    for robot in missing[: 9 - len(seen[2])]:  # nine of eleven are 80 %
        robot.say("enabled", 2)
    ended = fleet.until(rollout, state="finished")
    assert [step["kind"] for step in ended["steps"]] == ["stage"] * 4 + ["finished"]
    assert ended["steps"][0]["key_id"] == ended["created_by"]
    assert ended["steps"][1]["key_id"] is None
    pointed = ok(fleet.admin.get(f"/v1/maps/{fleet.map_id}/published"))
    assert pointed["revision"] == 2
    assert fleet.having(2) == fleet.robots
    assert ok(fleet.admin.get(f"/v1/rollouts/{rollout}/robots"))["items"] == []


def test_a_roll_out_goes_its_whole_way_on_sqlite(server: Server) -> None:
    _whole_way(server)


@pytest.mark.postgres
def test_a_roll_out_goes_its_whole_way_on_postgresql(postgres_served: Server) -> None:
    _whole_way(postgres_served)


def _brake(server: Server) -> None:
    fleet = Fleet(server, robots=6)
    rollout = fleet.begin(ALL, failure_limit=2)
    good, bad, worse, idle, *_ = fleet.robots
    good.say("enabled", 2)
    bad.say("failed", 2, "disk full")
    bad.say("downloaded", 2)  # trying again takes nothing back
    worse.say("failed", 1, "about another revision")
    time.sleep(1.2)
    assert fleet.rollout(rollout)["state"] == "running"
    assert [f["detail"] for f in fleet.rollout(rollout)["failed"]] == ["disk full"]
    worse.say("failed", 2, "localization lost")
    stopped = fleet.until(rollout, state="stopped")
    for words in (bad.id, "disk full", worse.id, "localization lost", "2 robots failed with revision 2"):
        assert words in stopped["reason"]
    assert (good.told(), bad.told(), worse.told(), idle.told()) == (2, 1, 1, 1)
    assert (stopped["taken"], stopped["enabled"]) == (1, 1)
    refused(fleet.publish(2), 409, "rollout-under-way")
    resumed = fleet.change(rollout, "resume")
    assert (resumed["state"], resumed["reason"], resumed["taken"]) == ("running", None, 6)
    time.sleep(1.2)
    assert fleet.rollout(rollout)["state"] == "running", "old failures are forgiven"
    assert idle.told() == 2
    worse.say("failed", 2, "again")
    worse.say("enabled", 2)  # a failure that was got over
    bad.say("failed", 2, "disk full again")
    time.sleep(1.2)
    assert fleet.rollout(rollout)["state"] == "running"
    aborted = fleet.change(rollout, "abort")
    assert aborted["state"] == "aborted"
    assert fleet.having(1) == fleet.robots
    refused(fleet.admin.post(f"/v1/rollouts/{rollout}/resume"), 409, "rollout-not-in-state")
    assert [step["kind"] for step in aborted["steps"]] == [
        "stage",
        "stopped",
        "resumed",
        "stage",
        "aborted",
    ]
    ok(fleet.publish(2))


def test_failures_stop_a_roll_out_on_sqlite(server: Server) -> None:
    _brake(server)


@pytest.mark.postgres
def test_failures_stop_a_roll_out_on_postgresql(postgres_served: Server) -> None:
    _brake(postgres_served)


def test_a_paused_roll_out_begins_no_stage_and_a_young_one_waits(server: Server) -> None:
    fleet = Fleet(server, robots=2, canaries=1)
    canary, other = fleet.robots
    rollout = fleet.begin({**CANARIES, "min_s": 2.0}, ALL)
    canary.say("enabled", 2)
    assert fleet.change(rollout, "pause")["state"] == "paused"
    refused(fleet.admin.post(f"/v1/rollouts/{rollout}/pause"), 409, "rollout-not-in-state")
    time.sleep(2.2)
    assert fleet.rollout(rollout)["stage"] == 0
    begun = time.monotonic()
    fleet.change(rollout, "resume")
    assert other.told() == 1
    fleet.until(rollout, stage=1)
    assert time.monotonic() - begun >= 2.0
    assert other.told() == 2


def test_robots_that_come_later_or_move_have_what_the_roll_out_says(server: Server) -> None:
    fleet = Fleet(server, robots=2, canaries=1)
    rollout = fleet.begin(CANARIES, ALL)
    assert fleet.enrol("canary").told() == 2
    late = fleet.enrol()
    assert late.told() == 1
    for change, told in (({"group": "canary"}, 2), ({"group": None}, 1)):
        ok(fleet.admin.patch(f"/v1/robots/{late.id}", json=change))
        assert late.told() == told
    ok(fleet.publish(1, "canary"))
    ok(fleet.admin.patch(f"/v1/robots/{fleet.robots[0].id}", json={"channel": "canary"}))
    assert fleet.robots[0].told() == 1, "it follows another channel now"
    assert fleet.rollout(rollout)["taken"] == 1


def test_a_poll_tells_each_robot_its_own_and_notices_within_a_second(server: Server) -> None:
    fleet = Fleet(server, robots=2, canaries=1)
    second = start(server.settings, admin_key=server.admin_key)
    try:
        where = f"/v1/maps/{fleet.map_id}/published"
        canary, other = (second.client(robot.client.headers["authorization"][7:]) for robot in fleet.robots)
        tags = [client.get(where).headers["etag"] for client in (canary, other)]
        for asked in ({}, {"channel": "stable"}):
            for client, tag in zip((canary, other), tags, strict=True):
                told = client.get(where, params=asked, headers={"If-None-Match": tag})
                assert told.status_code == 304
        rollout = fleet.begin(CANARIES, ALL)
        begun = time.monotonic()
        answer = soon(lambda: _new(canary, where, tags[0]))
        assert time.monotonic() - begun < 1.0
        assert ok(answer)["revision"] == 2
        assert {a["url"].split("/")[7] for a in answer.json()["artifacts"]} == {"2"}
        again = {"If-None-Match": answer.headers["etag"]}
        assert canary.get(where, headers=again).status_code == 304
        assert other.get(where, headers={"If-None-Match": tags[1]}).status_code == 304
        fleet.change(rollout, "abort")
        begun = time.monotonic()
        back = soon(lambda: _new(canary, where, answer.headers["etag"]))
        assert time.monotonic() - begun < 1.0
        assert (ok(back)["revision"], back.headers["etag"]) == (1, tags[0])
    finally:
        second.close()


def _new(client: httpx.Client, where: str, tag: str) -> httpx.Response | None:
    answer = client.get(where, headers={"If-None-Match": tag})
    return None if answer.status_code == 304 else answer


@pytest.mark.postgres
def test_of_two_services_one_takes_each_step(postgres_served: Server) -> None:
    fleet = Fleet(postgres_served, robots=6)
    second = start(postgres_served.settings, admin_key=postgres_served.admin_key)
    try:
        shares = [{"share": round(0.1 * k, 1)} for k in range(1, 11)]
        rollout = fleet.begin(*shares)
        for robot in fleet.robots:
            robot.say("enabled", 2)
        ended = fleet.until(rollout, state="finished")
    finally:
        second.close()
    assert [step["stage"] for step in ended["steps"]] == [*range(10), 9]
    moves = ok(fleet.admin.get(f"/v1/maps/{fleet.map_id}/published"))
    assert moves["revision"] == 2


def test_what_cannot_be_rolled_out(server: Server, by_hand: ByHand, client_for: ClientFor) -> None:
    fleet = Fleet(server, robots=2, canaries=1)
    admin, where = fleet.admin, f"/v1/maps/{fleet.map_id}/rollouts"

    def body(*stages: object, **more: object) -> dict[str, object]:
        return {"revision": 2, "stages": list(stages), **more}

    refused(admin.post(where, json=body(ALL, revision=1)), 422, "invalid-request")
    refused(admin.post(where, json=body(ALL, revision=9)), 404, "revision-not-found")
    refused(admin.post(where, json=body(ALL, channel="beta")), 404, "nothing-published")
    assert (
        refused(admin.post(where, json=body(ALL, {"group": "dock"})), 422, "invalid-request")["errors"][0][
            "pointer"
        ]
        == "#/stages/1"
    )
    for stages in ([], [HALF, TENTH], [{}], [{**ALL, "group": "canary"}], [{"share": 0}], [{"share": 1.1}]):
        refused(admin.post(where, json=body(*stages)), 422, "invalid-request")
    refused(admin.post(where, json=body(ALL, failure_limit=0)), 422, "invalid-request")
    empty = a_map(admin)
    for _ in range(2):
        a_ready_revision(admin, by_hand, empty)
    ok(admin.post(f"/v1/maps/{empty}/revisions/1/publish", json={}))
    refused(admin.post(f"/v1/maps/{empty}/rollouts", json=body(ALL)), 422, "invalid-request")
    rollout = fleet.begin(CANARIES)
    under_way = refused(admin.post(where, json=body(ALL)), 409, "rollout-under-way")
    assert under_way["rollout_id"] == rollout
    for role in ("tablet", "robot"):
        key = client_for(role)
        refused(key.post(where, json=body(ALL)), 403, "forbidden")
        for verb in ("pause", "resume", "abort"):
            refused(key.post(f"/v1/rollouts/{rollout}/{verb}"), 403, "forbidden")
    tablet, robot, stranger = client_for("tablet"), client_for("robot"), client_for("admin", [empty])
    assert ok(tablet.get(f"/v1/rollouts/{rollout}"))["id"] == rollout
    for path in (f"/v1/rollouts/{rollout}", f"/v1/rollouts/{rollout}/robots", where):
        refused(robot.get(path), 403, "forbidden")
    for path in (f"/v1/rollouts/{rollout}", f"/v1/rollouts/{rollout}/robots", "/v1/rollouts/rol_none"):
        refused(stranger.get(path), 404, "rollout-not-found")
    refused(stranger.post(f"/v1/rollouts/{rollout}/abort"), 404, "rollout-not-found")
    listed = ok(tablet.get(where, params={"state": "running", "channel": "stable"}))["items"]
    assert [found["id"] for found in listed] == [rollout]
    assert ok(tablet.get(where, params={"state": "stopped"}))["items"] == []


@given(
    st.sets(st.text("0123456789abcdef", min_size=4, max_size=8), min_size=1, max_size=60), st.floats(0.01, 1)
)
def test_a_share_takes_so_many_and_larger_shares_take_more(robots: set[str], share: float) -> None:
    def taken(part: float) -> set[str]:
        bound = bound_of("rol_1", robots, share=part)
        begun = [Stage(None, part)]
        return {r for r in robots if takes("rol_1", r, group=None, begun=begun, bound=bound)}

    assert len(taken(share)) == math.ceil(share * len(robots) - 1e-9)
    assert taken(share / 2) <= taken(share)
    assert taken(1.0) == robots
