"""The API's reference at `/docs`, in a browser that can reach this service and nothing else."""

from __future__ import annotations

import re

import httpx
from playwright.sync_api import Route, expect

from tests import web
from tests.browser.conftest import Visit
from tests.server import Server
from tests.service.asking import a_map, ok


def test_the_reference_needs_no_other_server(visit: Visit, server: Server) -> None:
    watched = visit(server.url)
    page = watched.page
    asked: list[str] = []

    def only_here(route: Route) -> None:
        asked.append(route.request.url)
        if route.request.url.startswith((f"{server.url}/", "data:", "blob:")):
            route.continue_()
        else:
            route.abort()

    page.route("**/*", only_here)
    page.goto(f"{server.url}/docs")
    paths = ok(web.get(f"{server.url}/openapi.json"))["paths"]
    operations = sum(len(methods) for methods in paths.values())
    expect(page.locator(".opblock")).to_have_count(operations)
    page.locator(".opblock", has_text=re.compile("GET/v1/maps(?!/)")).first.click()
    expect(page.get_by_text("Responses", exact=True).first).to_be_visible()
    page.wait_for_load_state("networkidle")
    beside = [url for url in asked if not url.startswith((f"{server.url}/", "data:", "blob:"))]
    assert beside == []
    assert len(asked) > 3
    watched.clean()


def test_a_key_tries_an_operation_out(visit: Visit, server: Server, admin: httpx.Client) -> None:
    map_id = a_map(admin)
    watched = visit(server.url)
    page = watched.page
    page.goto(f"{server.url}/docs")
    page.get_by_role("button", name="Authorize").click()
    bearer = page.locator(".auth-container", has_text="(http, Bearer)")
    bearer.get_by_role("textbox").fill(server.admin_key)
    bearer.get_by_role("button", name="Apply credentials").click()
    bearer.get_by_role("button", name="Close").click()
    operation = page.locator("#operations-maps-list_maps")
    operation.get_by_role("button").first.click()
    operation.get_by_role("button", name="Try it out").click()
    operation.get_by_role("button", name="Execute").click()
    expect(operation.locator(".live-responses-table td.response-col_status").nth(1)).to_contain_text("200")
    expect(operation.locator(".live-responses-table")).to_contain_text(map_id)
    watched.clean()
