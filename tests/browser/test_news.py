"""A page hears of its jobs whatever stands before the service."""

from __future__ import annotations

import re
from pathlib import Path

import httpx
from playwright.sync_api import Route, expect

from tests.browser.conftest import Watched
from tests.factories import a_drawing_png
from tests.forked import forked
from tests.server import Server, environment
from tests.service.asking import a_map, ok


def test_a_front_that_answers_for_the_service_ends_no_waiting(
    signed_in: Watched, server: Server, admin: httpx.Client, tmp_path: Path
) -> None:
    page, map_id = signed_in.page, a_map(admin)
    a_drawing_png(tmp_path / "hall.png")
    files = {"file": ("hall.png", (tmp_path / "hall.png").read_bytes())}
    drawing = ok(admin.post(f"/v1/maps/{map_id}/drawings", files=files), 202)["drawing"]
    refused: list[str] = []

    def answer(route: Route) -> None:
        if len(refused) < 2:
            refused.append(route.request.url)
            route.fulfill(status=502, content_type="text/html", body="<html>Bad Gateway</html>")
        else:
            route.continue_()

    page.route(re.compile(r"/v1/jobs/\w+/events$"), answer)
    with page.expect_response(lambda one: one.url.endswith("/events") and one.status == 200):
        page.goto(f"{server.url}/#/maps/{map_id}/drawings/{drawing['id']}")
    assert len(refused) == 2
    with (tmp_path / "worker.log").open("wb") as log:
        worker = forked("worker", env=environment(server.settings), stdout=log, stderr=log)
    try:
        expect(page.locator("canvas.sheet").or_(page.get_by_role("application")).first).to_be_visible()
    finally:
        worker.terminate()
        assert worker.wait() == 0
