"""Each route for each role, without a key, and for things of a map that the key does not cover."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import httpx
import pytest
from sqlalchemy import func, select

from service.db.models import Job
from tests import web
from tests.server import ClientFor, Server
from tests.service.asking import a_map, a_placement, a_ready_revision, ok, refused
from tests.service.by_hand import NO_TILES, ByHand
from tests.service.test_proposals import a_proposal

EVERYBODY = frozenset({"robot", "tablet", "admin"})
STAFF = frozenset({"tablet", "admin"})
ADMINS = frozenset({"admin"})


@dataclass(frozen=True)
class Route:
    """Hold who may use a route and, where it belongs to a map, what a foreign key is told.

    Parameters
    ----------
    foreign : str, optional
        Slug of the refusal when the key does not cover the map; "forbidden" where only a key of all maps
        will do; None where the route shows each key its own.
    """

    method: str
    path: str
    roles: frozenset[str]
    foreign: str | None
    body: dict[str, Any] | None = None
    form: bool = False


NOT_YET = {"delta-not-ready", "export-not-ready"}
HOOK = {"url": "https://plant.example/hook", "events": ["job.failed"]}
ROUTES = (
    Route("POST", "/v1/maps", ADMINS, "forbidden", {"site": "S", "name": "new"}),
    Route("GET", "/v1/maps", EVERYBODY, None),
    Route("GET", "/v1/maps/{map_id}", EVERYBODY, "map-not-found"),
    Route("PATCH", "/v1/maps/{map_id}", ADMINS, "map-not-found", {}),
    Route("POST", "/v1/maps/{map_id}/drawings", STAFF, "map-not-found", form=True),
    Route("GET", "/v1/maps/{map_id}/drawings", EVERYBODY, "map-not-found"),
    Route("GET", "/v1/drawings/{drawing_id}", EVERYBODY, "drawing-not-found"),
    Route(
        "PATCH", "/v1/drawings/{drawing_id}", STAFF, "drawing-not-found", {"scale": {"metres_per_unit": 0.05}}
    ),
    Route("GET", "/v1/drawings/{drawing_id}/{name}", EVERYBODY, "drawing-not-found"),
    Route("POST", "/v1/maps/{map_id}/scans", STAFF, "map-not-found", form=True),
    Route("GET", "/v1/maps/{map_id}/scans", EVERYBODY, "map-not-found"),
    Route("GET", "/v1/scans/{scan_id}", EVERYBODY, "scan-not-found"),
    Route("GET", "/v1/scans/{scan_id}/preview.png", EVERYBODY, "scan-not-found"),
    Route("GET", "/v1/scans/{scan_id}/points", EVERYBODY, "scan-not-found"),
    Route("POST", "/v1/maps/{map_id}/revisions", STAFF, "map-not-found", {"base": 1}),
    Route("GET", "/v1/maps/{map_id}/revisions", EVERYBODY, "map-not-found"),
    Route("GET", "/v1/maps/{map_id}/revisions/{n}", EVERYBODY, "map-not-found"),
    Route("GET", "/v1/maps/{map_id}/revisions/{n}/artifacts", EVERYBODY, "map-not-found"),
    Route("GET", "/v1/maps/{map_id}/revisions/{n}/artifacts/{path}", EVERYBODY, "map-not-found"),
    Route("GET", "/v1/maps/{map_id}/revisions/{n}/delta?from=1", EVERYBODY, "map-not-found"),
    Route("GET", "/v1/maps/{map_id}/revisions/{n}/changes?since=1", EVERYBODY, "map-not-found"),
    Route("GET", "/v1/maps/{map_id}/revisions/{n}/link?path=point-cloud.pcd", EVERYBODY, "map-not-found"),
    Route("POST", "/v1/maps/{map_id}/revisions/{n}/publish", ADMINS, "map-not-found", {}),
    Route("GET", "/v1/maps/{map_id}/published", EVERYBODY, "map-not-found"),
    Route(
        "POST",
        "/v1/scans/{scan_id}/placements",
        STAFF,
        "scan-not-found",
        {"rough_pose": {"x_m": 0, "y_m": 0}},
    ),
    Route("GET", "/v1/scans/{scan_id}/placements", STAFF, "scan-not-found"),
    Route("GET", "/v1/placements/{placement_id}", STAFF, "placement-not-found"),
    Route("POST", "/v1/placements/{placement_id}/accept", STAFF, "placement-not-found", {}),
    Route("GET", "/v1/jobs", STAFF, None),
    Route("GET", "/v1/jobs/{job_id}", STAFF, "job-not-found"),
    Route("POST", "/v1/jobs/{job_id}/cancel", STAFF, "job-not-found"),
    Route("POST", "/v1/jobs/{job_id}/retry", STAFF, "job-not-found"),
    Route("GET", "/v1/jobs/{job_id}/events", STAFF, "job-not-found"),
    Route("POST", "/v1/keys", ADMINS, "forbidden", {"name": "k", "role": "robot"}),
    Route("GET", "/v1/keys", ADMINS, "forbidden"),
    Route("DELETE", "/v1/keys/{key_id}", ADMINS, "forbidden"),
    Route("POST", "/v1/robots", ADMINS, "map-not-found", {"name": "r", "map_id": "{map_id}"}),
    Route("GET", "/v1/robots", STAFF, None),
    Route("GET", "/v1/robots/{robot_id}", STAFF, "robot-not-found"),
    Route("PATCH", "/v1/robots/{robot_id}", ADMINS, "robot-not-found", {}),
    Route(
        "POST",
        "/v1/robots/{robot_id}/reports",
        ADMINS,
        "robot-not-found",
        {"revision": 1, "state": "verified"},
    ),
    Route("GET", "/v1/robots/{robot_id}/reports", STAFF, "robot-not-found"),
    Route("GET", "/v1/stats", ADMINS, "forbidden"),
    Route(
        "GET",
        "/v1/stats/series?what=jobs&since=2026-01-01T00:00:00Z&until=2026-01-02T00:00:00Z",
        ADMINS,
        "forbidden",
    ),
    Route("GET", "/v1/audit", ADMINS, None),
    Route("GET", "/v1/drawings", EVERYBODY, None),
    Route("GET", "/v1/scans", EVERYBODY, None),
    Route("GET", "/v1/revisions", EVERYBODY, None),
    Route("GET", "/v1/placements", STAFF, None),
    Route("GET", "/v1/maps/{map_id}/channels", EVERYBODY, "map-not-found"),
    Route("GET", "/v1/maps/{map_id}/publications", STAFF, "map-not-found"),
    Route("GET", "/v1/maps/{map_id}/proposals", STAFF, "map-not-found"),
    Route("POST", "/v1/proposals/{proposal_id}/accept", STAFF, "proposal-not-found"),
    Route("POST", "/v1/proposals/{proposal_id}/dismiss", STAFF, "proposal-not-found"),
    Route("GET", "/v1/maps/{map_id}/revisions/{n}/compare?with=1", STAFF, "map-not-found"),
    Route("GET", "/v1/maps/{map_id}/revisions/{n}/compare.png?with=1", STAFF, "map-not-found"),
    Route("GET", "/v1/maps/{map_id}/revisions/{n}/gates", STAFF, "map-not-found"),
    Route("POST", "/v1/maps/{map_id}/revisions/{n}/rebuild", ADMINS, "map-not-found"),
    Route("POST", "/v1/maps/{map_id}/revisions/{n}/exports", STAFF, "map-not-found", {"format": "ply"}),
    Route("GET", "/v1/maps/{map_id}/revisions/{n}/exports/{kind}", EVERYBODY, "map-not-found"),
    Route(
        "POST",
        "/v1/maps/{map_id}/rollouts",
        ADMINS,
        "map-not-found",
        {"revision": 1, "stages": [{"share": 1.0}]},
    ),
    Route("GET", "/v1/maps/{map_id}/rollouts", STAFF, "map-not-found"),
    Route("GET", "/v1/rollouts/{rollout_id}", STAFF, "rollout-not-found"),
    Route("GET", "/v1/rollouts/{rollout_id}/robots", STAFF, "rollout-not-found"),
    Route("POST", "/v1/rollouts/{rollout_id}/pause", ADMINS, "rollout-not-found"),
    Route("POST", "/v1/rollouts/{rollout_id}/resume", ADMINS, "rollout-not-found"),
    Route("POST", "/v1/rollouts/{rollout_id}/abort", ADMINS, "rollout-not-found"),
    Route("POST", "/v1/webhooks", ADMINS, "forbidden", HOOK),
    Route("GET", "/v1/webhooks", ADMINS, None),
    Route("GET", "/v1/webhooks/{webhook_id}", ADMINS, "webhook-not-found"),
    Route("GET", "/v1/webhooks/{webhook_id}/deliveries", ADMINS, "webhook-not-found"),
    Route("POST", "/v1/webhooks/{webhook_id}/secret", ADMINS, "webhook-not-found"),
    Route("DELETE", "/v1/webhooks/{webhook_id}", ADMINS, "webhook-not-found"),
    Route("GET", "/v1/convergence", STAFF, None),
    Route("GET", "/v1/proposals", STAFF, None),
    Route("GET", "/v1/session", EVERYBODY, None),
)
OPEN = {
    ("GET", "/healthz"),
    ("GET", "/readyz"),
    ("GET", "/metrics"),
    ("GET", "/problems/{slug}"),
    ("OPTIONS", "/v1/tus"),
    ("GET", "/v1/links/{map_id}/{n}/{path}"),
    ("PUT", "/v1/session"),
    ("DELETE", "/v1/session"),
}
TUS = {
    ("POST", "/v1/tus"),
    ("HEAD", "/v1/tus/{upload_id}"),
    ("PATCH", "/v1/tus/{upload_id}"),
    ("DELETE", "/v1/tus/{upload_id}"),
}
"""Resumable uploads have a file of tests of their own, access included."""
ENDLESS = {("GET", "/v1/events")}
"""The fleet's events never end; who may listen is tested where they are."""


@pytest.fixture(scope="module")
def ids(admin: httpx.Client, by_hand: ByHand) -> dict[str, str]:
    """Give one of each thing, all of one map."""
    map_id = a_map(admin)
    made = ok(admin.post(f"/v1/maps/{map_id}/revisions", json={"drawing_id": by_hand.drawing(map_id)}), 202)
    by_hand.build(made["job"]["id"], more={"manifest.json": NO_TILES})
    ok(admin.post(f"/v1/maps/{map_id}/revisions/1/publish", json={}))
    placement_id = a_placement(admin, by_hand, map_id)
    placement = ok(admin.get(f"/v1/placements/{placement_id}"))
    drawing = ok(admin.get(f"/v1/maps/{map_id}/drawings"))["items"][0]
    spare = ok(admin.post("/v1/keys", json={"name": "spare", "role": "robot"}), 201)
    robot = ok(admin.post("/v1/robots", json={"name": "robot", "map_id": map_id}), 201)
    second = a_ready_revision(admin, by_hand, map_id)
    plan = {"revision": second, "stages": [{"share": 1.0}]}
    return {
        "map_id": map_id,
        "robot_id": robot["id"],
        "n": "1",
        "path": "point-cloud.pcd",
        "drawing_id": drawing["id"],
        "name": "walls.geojson",
        "scan_id": placement["scan_id"],
        "placement_id": placement_id,
        "job_id": placement["job_id"],
        "key_id": spare["id"],
        "kind": "ply",
        "proposal_id": a_proposal(admin, by_hand, map_id, "lyr_none", whole=True)["id"],
        "rollout_id": ok(admin.post(f"/v1/maps/{map_id}/rollouts", json=plan), 201)["id"],
        "webhook_id": ok(admin.post("/v1/webhooks", json=HOOK | {"map_ids": [map_id]}), 201)["id"],
    }


def _ask(client: httpx.Client, route: Route, ids: dict[str, str]) -> httpx.Response:
    more: dict[str, Any] = {}
    if route.body is not None:
        more["json"] = {
            name: value.format(**ids) if isinstance(value, str) else value
            for name, value in route.body.items()
        }
    if route.form:
        more["files"] = {"file": ("file", b"text", "text/plain")}
    return client.request(route.method, route.path.format(**ids), **more)


def test_every_route_is_in_the_table(server: Server) -> None:
    schema = ok(web.get(f"{server.url}/openapi.json"))
    routes = {(method.upper(), path) for path, methods in schema["paths"].items() for method in methods}
    assert routes == {(route.method, route.path.partition("?")[0]) for route in ROUTES} | OPEN | TUS | ENDLESS
    keyless = {
        (method.upper(), path)
        for path, methods in schema["paths"].items()
        for method, operation in methods.items()
        if not operation.get("security")
    }
    assert keyless == OPEN


@dataclass(frozen=True)
class Holders:
    """Hold a client of each role for the things' map, for another map, and for all maps."""

    own: dict[str, httpx.Client]
    foreign: dict[str, httpx.Client]
    everywhere: dict[str, httpx.Client]


@pytest.fixture(scope="module")
def holders(admin: httpx.Client, ids: dict[str, str], client_for: ClientFor) -> Holders:
    other = a_map(admin)
    return Holders(
        {role: client_for(role, [ids["map_id"]]) for role in EVERYBODY},
        {role: client_for(role, [other]) for role in EVERYBODY},
        {role: client_for(role) for role in EVERYBODY},
    )


@pytest.mark.parametrize("route", ROUTES, ids=lambda route: f"{route.method} {route.path}")
def test_a_route_is_open_to_its_roles_alone(
    route: Route, server: Server, ids: dict[str, str], holders: Holders
) -> None:
    answer = _ask(server.client(None), route, ids)
    refused(answer, 401, "unauthenticated")
    assert answer.headers["www-authenticate"].startswith("Bearer")
    for role in sorted(EVERYBODY):
        if role not in route.roles:
            problem = refused(_ask(holders.own[role], route, ids), 403, "forbidden")
            assert set(problem["required_roles"]) == route.roles
            continue
        told = _ask(holders.foreign[role], route, ids)
        if route.foreign is None:
            assert ids["map_id"] not in told.text
            ok(told)
        else:
            refused(told, 403 if route.foreign == "forbidden" else 404, route.foreign)


@pytest.mark.parametrize("route", ROUTES, ids=lambda route: f"{route.method} {route.path}")
def test_a_route_lets_its_roles_in(route: Route, ids: dict[str, str], holders: Holders) -> None:
    for role in sorted(route.roles):
        client = (holders.everywhere if route.foreign == "forbidden" else holders.own)[role]
        answer = _ask(client, route, ids)
        if answer.status_code >= 400:
            slug = answer.json()["type"].rpartition("/")[2]
            assert slug not in {"unauthenticated", "forbidden", "map-not-found", route.foreign}, answer.text
            assert answer.status_code < 500 or slug in NOT_YET


def test_a_robots_key_begins_no_job_but_the_delta_that_it_downloads(
    server: Server, ids: dict[str, str], holders: Holders
) -> None:
    def jobs() -> int:
        with server.kernel.db.reading() as session:
            return session.scalar(select(func.count()).select_from(Job)) or 0

    before, began = jobs(), []
    for route in ROUTES:
        for robot in (holders.own["robot"], holders.everywhere["robot"]):
            _ask(robot, route, ids)
        if jobs() != before:
            began.append(route.path.partition("?")[0])
            before = jobs()
    assert set(began) <= {"/v1/maps/{map_id}/revisions/{n}/delta"}
    upload = {"Tus-Resumable": "1.0.0", "Upload-Length": "9", "Upload-Metadata": "kind c2Nhbg=="}
    refused(holders.own["robot"].post("/v1/tus", headers=upload), 403, "forbidden")


def test_a_thing_of_another_map_is_told_like_none_at_all(
    admin: httpx.Client, ids: dict[str, str], client_for: ClientFor
) -> None:
    stranger = client_for("tablet", [a_map(admin)])
    for kind, path in (
        ("scan_id", "/v1/scans/"),
        ("placement_id", "/v1/placements/"),
        ("job_id", "/v1/jobs/"),
    ):
        foreign, missing = stranger.get(path + ids[kind]), stranger.get(path + "none")
        assert (foreign.status_code, missing.status_code) == (404, 404)
        assert foreign.text.replace(ids[kind], "none") == missing.text


def test_keys_that_hold_no_more(server: Server, admin: httpx.Client) -> None:
    soon = (datetime.now(UTC) + timedelta(seconds=1.5)).isoformat()
    short = ok(admin.post("/v1/keys", json={"name": "k", "role": "robot", "expires_at": soon}), 201)
    long = ok(admin.post("/v1/keys", json={"name": "k", "role": "robot"}), 201)
    brief, revoked = server.client(short["key"]), server.client(long["key"])
    ok(brief.get("/v1/maps"))
    ok(revoked.get("/v1/maps"))
    for _ in range(2):
        assert admin.delete(f"/v1/keys/{long['id']}").status_code == 204
    assert "revoked" in refused(revoked.get("/v1/maps"), 401, "unauthenticated")["detail"]
    while brief.get("/v1/maps").status_code == 200:
        pass
    assert "expired" in refused(brief.get("/v1/maps"), 401, "unauthenticated")["detail"]
    listed, cursor = {}, ""
    while cursor is not None:
        page = ok(admin.get("/v1/keys", params={"cursor": cursor} if cursor else {}))
        listed |= {key["id"]: key for key in page["items"]}
        cursor = page["next_cursor"]
    assert listed[long["id"]]["revoked_at"]
    assert "key" not in listed[long["id"]]


@pytest.mark.parametrize(
    "header", ["gp_x", "Bearer", "Bearer ", "Basic Z3A6eA==", "Bearer gp_" + "x" * 43, "Bearer " + "y" * 9000]
)
def test_what_is_no_key(server: Server, header: str) -> None:
    answer = server.client(None).get("/v1/maps", headers={"Authorization": header.strip()})
    refused(answer, 401, "unauthenticated")


@pytest.mark.parametrize(
    ("body", "status"),
    [
        ({"name": "k", "role": "owner"}, 422),
        ({"name": "k", "role": "robot", "map_ids": []}, 422),
        ({"name": "k", "role": "robot", "map_ids": ["map_none"]}, 404),
        ({"name": "k", "role": "robot", "expires_at": "2020-01-01T00:00:00Z"}, 422),
        ({"name": "k", "role": "robot", "expires_at": "2090-01-01T00:00:00"}, 422),
    ],
)
def test_keys_that_cannot_be_made(admin: httpx.Client, body: dict[str, Any], status: int) -> None:
    answer = admin.post("/v1/keys", json=body)
    assert answer.status_code == status, answer.text
