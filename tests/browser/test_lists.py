"""The pages of an admin: right, accessible, without a fault, and usable with ten thousand rows."""

from __future__ import annotations

from datetime import timedelta

import httpx
from playwright.sync_api import expect
from sqlalchemy import insert

from service.db.models import Key
from service.domain.ids import new_id
from tests import web
from tests.browser.conftest import Visit, Watched
from tests.server import Server
from tests.service.asking import a_map, ok

ROWS = 10_000


def test_every_page_is_accessible_and_without_a_fault(
    signed_in: Watched, admin: httpx.Client, server: Server
) -> None:
    page = signed_in.page
    a_map(admin)
    for place, heading in [
        ("", "Overview"),
        ("jobs", "Jobs"),
        ("fleet", "Fleet"),
        ("audit", "Audit"),
        ("keys", "Keys"),
        ("system", "System"),
    ]:
        page.goto(f"{server.url}/#/{place}")
        expect(page.get_by_role("heading", name=heading, exact=True)).to_be_visible()
        expect(page.locator(".loading")).to_have_count(0)
        signed_in.accessible()
        page.get_by_role("button", name="Light or dark").click()
        signed_in.accessible()
        page.get_by_role("button", name="Light or dark").click()
    signed_in.clean()


def test_what_a_role_may_not_is_not_offered(visit: Visit, server: Server, admin: httpx.Client) -> None:
    map_id = a_map(admin)
    key = ok(admin.post("/v1/keys", json={"name": "pad", "role": "tablet", "map_ids": [map_id]}), 201)["key"]
    watched = visit(server.url)
    watched.sign_in(key)
    for name in ("Audit", "Keys"):
        expect(watched.page.get_by_role("link", name=name)).to_have_count(0)
    expect(watched.page.get_by_role("button", name="New map")).to_have_count(0)
    expect(watched.page.locator(".map-card")).to_have_count(1)
    watched.page.goto(f"{server.url}/#/keys")
    expect(watched.page.get_by_role("heading", name="Overview")).to_be_visible()
    watched.clean()


def test_a_map_and_a_key_are_made_and_the_key_revoked(signed_in: Watched, server: Server) -> None:
    page = signed_in.page
    page.get_by_role("button", name="New map").click()
    page.get_by_label("Site").fill("Osaka")
    page.get_by_label("Floor or hall").fill("hall 7")
    page.get_by_role("button", name="Make the map").click()
    expect(page.get_by_role("heading", name="hall 7")).to_be_visible()
    signed_in.accessible()
    page.get_by_role("link", name="Keys").click()
    page.get_by_role("button", name="New key").click()
    page.get_by_label("Name").fill("pad of hall 7")
    page.get_by_role("button", name="Make the key").click()
    secret = page.locator("code.secret").inner_text()
    assert (
        ok(web.get(f"{server.url}/v1/session", headers={"Authorization": f"Bearer {secret}"}))["role"]
        == "tablet"
    )
    page.get_by_role("button", name="Close").click()
    row = page.get_by_role("row").filter(has_text="pad of hall 7")
    row.get_by_role("button", name="Revoke").click()
    page.get_by_role("dialog").get_by_role("button", name="Revoke").click()
    expect(row.get_by_text("Revoked")).to_be_visible()
    assert (
        web.get(f"{server.url}/v1/session", headers={"Authorization": f"Bearer {secret}"}).status_code == 401
    )
    signed_in.clean()


def test_a_list_of_ten_thousand_rows_holds_few_of_them(signed_in: Watched, server: Server) -> None:
    kernel, now = server.kernel, server.kernel.now()
    rows = [
        {
            "id": new_id("key", now=now + timedelta(milliseconds=k), entropy=kernel.entropy),
            "name": f"robot {k:05d}", "role": "robot", "digest": f"{k:064x}", "created_at": now,
        }
        for k in range(ROWS)
    ]  # fmt: skip
    with kernel.db.writing("many-keys") as session:
        session.execute(insert(Key), rows)
    page = signed_in.page
    page.goto(f"{server.url}/#/keys")
    table = page.get_by_role("table", name="Keys")
    expect(page.get_by_text("robot 00003")).to_be_visible()
    last = page.get_by_text(f"robot {ROWS - 1:05d}")
    for _ in range(200):
        table.evaluate("box => box.scrollTo(0, box.scrollHeight)")
        page.wait_for_timeout(20)
        if last.count():
            break
    expect(last).to_be_visible()
    assert page.get_by_role("row").count() < 60
    signed_in.clean()
