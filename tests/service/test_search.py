"""Lists over all maps: narrowed, in both orders, page by page, only what the key covers; counts over time."""

from __future__ import annotations

from datetime import timedelta
from typing import Any

import httpx
import pytest

from service.domain.ids import made_at
from tests.server import Server, new_client
from tests.service.asking import a_map, a_placement, a_ready_revision, ok, refused
from tests.service.by_hand import ByHand


def every(client: httpx.Client, where: str, **asked: Any) -> list[str]:
    """Return the ids of a list, all pages of it."""
    found: list[str] = []
    cursor = None
    while True:
        told = {**asked, "limit": 2} | ({} if cursor is None else {"cursor": cursor})
        page = ok(client.get(where, params=told))
        found += [one["id"] if "id" in one else f"{one['map_id']} {one['n']}" for one in page["items"]]
        cursor = page["next_cursor"]
        if cursor is None:
            return found


def _story(server: Server) -> None:
    admin, by_hand = server.client(server.admin_key), ByHand(server.kernel)
    maps = [a_map(admin), a_map(admin)]
    for map_id in maps:
        for _ in range(3):
            a_ready_revision(admin, by_hand, map_id)
    accepted = [a_placement(admin, by_hand, map_id) for map_id in maps]
    doubtful = a_placement(admin, by_hand, maps[0], verdict="needs-review")

    newest = [f"{m} {n}" for m in reversed(maps) for n in (3, 2, 1)]
    assert every(admin, "/v1/revisions") == newest
    assert every(admin, "/v1/revisions", order="oldest") == newest[::-1]
    assert every(admin, "/v1/revisions", map=maps[0], status="ready") == newest[3:]
    assert every(admin, "/v1/revisions", status="failed") == []
    assert every(admin, "/v1/placements") == [doubtful, *accepted[::-1]]
    assert every(admin, "/v1/placements", verdict="needs-review") == [doubtful]
    assert every(admin, "/v1/placements", map=maps[1]) == accepted[1:]
    assert len(every(admin, "/v1/drawings", q="HALL")) == 6
    assert every(admin, "/v1/drawings", q="no such") == []
    scans = every(admin, "/v1/scans", order="oldest")
    assert len(scans) == 3
    middle = made_at(scans[1])
    assert every(admin, "/v1/scans", since=middle.isoformat(), order="oldest") == scans[1:]
    assert every(admin, "/v1/scans", until=middle.isoformat()) == scans[:1]
    jobs = every(admin, "/v1/jobs", kind="build-revision", map=maps[0])
    assert len(jobs) == 3
    assert every(admin, "/v1/jobs", kind="build-revision", map=maps[0], order="oldest") == jobs[::-1]

    one_map = new_client(server, "tablet", maps=[maps[1]])
    assert every(one_map, "/v1/revisions") == newest[:3]
    assert every(one_map, "/v1/placements") == accepted[1:]
    assert every(one_map, "/v1/scans", map=maps[0]) == []
    refused(new_client(server, "robot").get("/v1/placements"), 403, "forbidden")

    period = {
        "since": (middle - timedelta(hours=2)).isoformat(),
        "until": (middle + timedelta(hours=2)).isoformat(),
    }
    counted = ok(admin.get("/v1/stats/series", params={"what": "revisions", **period}))["points"]
    assert sum(point["number"] for point in counted) == 6
    assert {point["state"] for point in counted} == {"ready"}
    by_day = ok(admin.get("/v1/stats/series", params={"what": "scans", "bucket": "day", **period}))["points"]
    assert sum(point["number"] for point in by_day) == 3
    assert all(point["at"].endswith("T00:00:00Z") for point in by_day)
    for since in ("9999-12-31T00:00:00Z", "1969-12-31T00:00:00Z", "0001-01-01T00:00:00Z"):
        last = {"since": since, "until": f"{since[:10]}T23:59:59Z", "what": "scans"}
        assert ok(admin.get("/v1/stats/series", params={"bucket": "day", **last}))["points"] == []
    long = {**period, "since": "2020-01-01T00:00:00Z"}
    refused(admin.get("/v1/stats/series", params={"what": "jobs", **long}), 422, "invalid-request")
    refused(one_map.get("/v1/stats/series", params={"what": "jobs", **period}), 403, "forbidden")
    assert ok(admin.get("/v1/stats"))["totals"]["revisions"] == 6


def test_things_are_found_over_all_maps(server: Server) -> None:
    _story(server)


@pytest.mark.postgres
def test_things_are_found_over_all_maps_on_postgresql(postgres_served: Server) -> None:
    _story(postgres_served)
