"""A key in a browser: kept from scripts, sent by our own pages alone, and never worth more than the key."""

from __future__ import annotations

import httpx
import pytest
from playwright.sync_api import expect

from tests import web
from tests.browser.conftest import Visit, with_cookie
from tests.server import Server
from tests.service.asking import a_map, ok, refused

OWN_PAGE = {"X-Groundplan-Session": "1"}


def test_the_cookie_is_out_of_reach_of_scripts_and_foreign_pages(server: Server) -> None:
    answer = web.put(f"{server.url}/v1/session", json={"key": server.admin_key}, headers=OWN_PAGE)
    assert ok(answer) == {"key_id": "key_" + "0" * 26, "role": "admin", "map_ids": None}
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    assert "Secure" not in cookie  # reached by http here
    assert answer.headers["cache-control"] == "no-store"


def test_a_wrong_key_does_not_sign_in(server: Server) -> None:
    answer = web.put(f"{server.url}/v1/session", json={"key": "gp_wrong"}, headers=OWN_PAGE)
    refused(answer, 401, "unauthenticated")
    assert "set-cookie" not in answer.headers


def test_the_cookie_reads_but_changes_nothing_without_our_header(server: Server, admin: httpx.Client) -> None:
    before = len(ok(admin.get("/v1/maps"))["items"])
    with with_cookie(server.url, server.admin_key) as browser:
        ok(browser.get("/v1/maps"))
        body = {"site": "Plant", "name": "forged"}
        refused(browser.post("/v1/maps", json=body), 403, "origin-not-proven")
        assert len(ok(browser.get("/v1/maps"))["items"]) == before
        assert browser.post("/v1/maps", json=body, headers=OWN_PAGE).status_code == 201


@pytest.mark.parametrize(
    "kind", ["application/x-www-form-urlencoded", "multipart/form-data; boundary=x", "text/plain"]
)
def test_a_stolen_form_is_refused(server: Server, admin: httpx.Client, kind: str) -> None:
    map_id = a_map(admin)
    with with_cookie(server.url, server.admin_key) as browser:
        for path in (f"/v1/maps/{map_id}/scans", f"/v1/maps/{map_id}/drawings", "/v1/keys"):
            answer = browser.post(path, content=b"name=forged", headers={"Content-Type": kind})
            refused(answer, 403, "origin-not-proven")
    assert ok(admin.get(f"/v1/maps/{map_id}/scans"))["items"] == []


def test_signing_in_or_out_is_not_for_foreign_pages(server: Server) -> None:
    refused(
        web.put(f"{server.url}/v1/session", json={"key": server.admin_key}),
        403,
        "origin-not-proven",
    )
    refused(web.delete(f"{server.url}/v1/session"), 403, "origin-not-proven")


def test_a_session_has_the_rights_of_its_key_and_ends_with_it(server: Server, admin: httpx.Client) -> None:
    mine, other = a_map(admin), a_map(admin)
    key = ok(admin.post("/v1/keys", json={"name": "pad", "role": "tablet", "map_ids": [mine]}), 201)
    with with_cookie(server.url, key["key"]) as browser:
        assert ok(browser.get("/v1/session"))["map_ids"] == [mine]
        refused(browser.get(f"/v1/maps/{other}"), 404, "map-not-found")
        refused(browser.get("/v1/keys"), 403, "forbidden")
        assert admin.delete(f"/v1/keys/{key['id']}").status_code == 204
        refused(browser.get("/v1/maps"), 401, "unauthenticated")


def test_after_signing_out_the_browser_has_no_key(server: Server) -> None:
    with with_cookie(server.url, server.admin_key) as browser:
        assert browser.delete("/v1/session", headers=OWN_PAGE).status_code == 204
        assert not browser.cookies
        refused(browser.get("/v1/session"), 401, "unauthenticated")


def test_a_bearer_key_needs_no_header(admin: httpx.Client) -> None:
    assert a_map(admin)


def test_the_language_is_the_browsers_until_another_is_chosen(visit: Visit, server: Server) -> None:
    watched = visit(server.url, locale="ja-JP")
    page = watched.page
    page.goto(server.url)
    page.get_by_label("キー").fill(server.admin_key)
    page.get_by_role("button", name="サインイン").click()
    expect(page.get_by_role("heading", name="概要")).to_be_visible()
    assert page.locator("html").get_attribute("lang") == "ja"
    watched.accessible()
    page.get_by_label("言語").select_option("en")
    expect(page.get_by_role("heading", name="Overview")).to_be_visible()
    page.reload()
    expect(page.get_by_role("heading", name="Overview")).to_be_visible()
