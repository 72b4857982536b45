"""The fleet page: who runs what, a roll-out that stops by itself and is aborted, a robot's own words."""

from __future__ import annotations

from pathlib import Path

import httpx
from playwright.sync_api import expect

from service.usecases.robots import remark_on
from tests.browser.conftest import Visit
from tests.server import Server
from tests.service.asking import ok
from tests.service.fleets import Fleet


def test_a_roll_out_is_begun_stops_by_itself_and_is_aborted(
    visit: Visit, server: Server, pictures: Path
) -> None:
    fleet = Fleet(server, robots=8)
    fleet.robots[0].say("failed", 1, "the disk is full")
    fleet.robots[1].say("enabled", 1)
    watched = visit(server.url)
    page = watched.page
    watched.sign_in(server.admin_key)
    page.get_by_role("link", name="Fleet").click()
    name = ok(fleet.admin.get(f"/v1/maps/{fleet.map_id}"))["name"]
    row = page.get_by_role("region", name="Robots by revision").get_by_role("row").filter(has_text=name)
    expect(row.get_by_text("8 Up to date")).to_be_attached()

    rollouts = page.get_by_role("region", name="Staged roll-outs")
    rollouts.get_by_label("Map").select_option(fleet.map_id)
    rollouts.get_by_role("button", name="Begin a roll-out").click()
    dialog = page.get_by_role("dialog")
    dialog.get_by_label("Shares of the robots").fill("25, 100")
    watched.accessible()
    dialog.get_by_role("button", name="Begin a roll-out").click()
    going = rollouts.get_by_role("listitem").filter(has_text=name)
    expect(going.get_by_text("Running")).to_be_visible()
    expect(going.get_by_text("0 / 2 run it")).to_be_visible()
    first, second = fleet.having(2)
    first.say("enabled", 2)
    expect(going.get_by_text("1 / 2 run it")).to_be_visible()
    expect(row.get_by_text("1 Up to date")).to_be_attached()
    second.say("failed", 2, "a torn download")
    expect(going.get_by_text("Stopped by failures")).to_be_visible()
    expect(going.get_by_text("a torn download")).to_be_visible()
    watched.accessible()
    page.screenshot(path=pictures / "fleet.png", full_page=True)

    robot = ok(fleet.admin.get(f"/v1/robots/{second.id}"))["name"]
    page.get_by_role("button", name=robot).click()
    expect(page.get_by_role("dialog").get_by_text("Failed · a torn download")).to_be_visible()
    page.keyboard.press("Escape")
    going.get_by_role("button", name="Abort").click()
    expect(going.get_by_text("Aborted")).to_be_visible()
    assert {robot.told() for robot in fleet.robots} == {1}
    watched.clean()


def test_a_tablet_sees_the_fleet_and_no_brake(visit: Visit, server: Server) -> None:
    fleet = Fleet(server, robots=2)
    fleet.begin({"share": 1.0})
    key = {"name": "pad", "role": "tablet", "map_ids": [fleet.map_id]}
    watched = visit(server.url)
    watched.sign_in(ok(fleet.admin.post("/v1/keys", json=key), 201)["key"])
    watched.page.get_by_role("link", name="Fleet").click()
    rollouts = watched.page.get_by_role("region", name="Staged roll-outs")
    expect(rollouts.get_by_text("Running")).to_be_visible()
    for word in ("Abort", "Pause", "Begin a roll-out"):
        expect(watched.page.get_by_role("button", name=word)).to_have_count(0)
    watched.clean()


def test_the_counts_agree_with_the_robots(server: Server, admin: httpx.Client) -> None:
    fleet = Fleet(server, robots=5)
    fleet.publish(2)
    for state, robot in zip(("enabled", "failed", "verified"), fleet.robots, strict=False):
        robot.say(state, 2)
    told = ok(admin.get("/v1/convergence", params={"map": fleet.map_id}))
    assert told["channels"] == [{"map_id": fleet.map_id, "channel": "stable", "revision": 2}]
    counted = {(one["enabled_revision"], one["progress"]): one["robots"] for one in told["robots"]}
    assert counted == {(2, "up-to-date"): 1, (1, "failed"): 1, (1, "not-enabled"): 1, (1, "not-begun"): 2}


def test_what_is_wrong_with_a_vehicle_is_seen_beside_it(visit: Visit, server: Server) -> None:
    robot = Fleet(server, robots=1).robots[0]
    remark_on(server.kernel, robot.id, "Its message on state cannot be read: /driving: Field required")
    watched = visit(server.url)
    page = watched.page
    watched.sign_in(server.admin_key)
    page.get_by_role("link", name="Fleet").click()
    told = ok(server.client(server.admin_key).get(f"/v1/robots/{robot.id}"))
    assert told["remark"].endswith("Field required")
    expect(page.get_by_text("Its messages: Its message on state cannot be read").first).to_be_visible()
    page.get_by_role("button", name=told["name"]).click()
    expect(page.get_by_role("dialog").get_by_text("/driving: Field required")).to_be_visible()
    watched.accessible()
    watched.clean()
