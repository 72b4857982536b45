"""Maps over HTTP."""

from __future__ import annotations

import httpx
import pytest

from tests.server import ClientFor
from tests.service.asking import a_map, ok, refused


def test_a_map_is_made_shown_and_renamed(admin: httpx.Client) -> None:
    answer = admin.post("/v1/maps", json={"site": " Plant A ", "name": "Floor 0"})
    made = ok(answer, 201)
    assert (made["site"], made["name"]) == ("Plant A", "Floor 0")
    assert answer.headers["location"] == f"/v1/maps/{made['id']}"
    assert ok(admin.get(answer.headers["location"])) == made
    renamed = ok(admin.patch(f"/v1/maps/{made['id']}", json={"name": "Floor 1"}))
    assert renamed == made | {"name": "Floor 1", "updated_at": renamed["updated_at"]}
    assert renamed["updated_at"] > made["updated_at"]


def test_a_name_is_unique_in_its_site(admin: httpx.Client) -> None:
    first = ok(admin.post("/v1/maps", json={"site": "U", "name": "one"}), 201)
    refused(admin.post("/v1/maps", json={"site": "U", "name": "one"}), 409, "map-name-taken")
    ok(admin.post("/v1/maps", json={"site": "V", "name": "one"}), 201)
    ok(admin.post("/v1/maps", json={"site": "U", "name": "two"}), 201)
    refused(admin.patch(f"/v1/maps/{first['id']}", json={"name": "two"}), 409, "map-name-taken")
    assert ok(admin.get(f"/v1/maps/{first['id']}")) == first


def test_lists_are_paged_without_gaps_and_filtered(admin: httpx.Client) -> None:
    made = [ok(admin.post("/v1/maps", json={"site": "Paged_%", "name": f"N{i}"}), 201) for i in range(7)]
    ok(admin.post("/v1/maps", json={"site": "PagedX", "name": "other"}), 201)
    seen, cursor = [], None
    while True:
        page = ok(
            admin.get(
                "/v1/maps", params={"site": "Paged_%", "limit": 3, **({"cursor": cursor} if cursor else {})}
            )
        )
        assert len(page["items"]) <= 3
        seen += page["items"]
        cursor = page["next_cursor"]
        if cursor is None:
            break
    assert seen == made
    assert [m["id"] for m in ok(admin.get("/v1/maps?q=ged_%25&limit=200"))["items"]] == [
        m["id"] for m in made
    ]
    assert [m["name"] for m in ok(admin.get("/v1/maps?q=n3&site=Paged_%25"))["items"]] == ["N3"]


@pytest.mark.parametrize("cursor", ["x", "", "%00", "W10", "bnVsbA", "é", "." * 600])
def test_a_cursor_that_no_list_gave_is_refused(admin: httpx.Client, cursor: str) -> None:
    refused(admin.get("/v1/maps", params={"cursor": cursor}), 422, "invalid-request")


def test_a_cursor_fits_only_its_filters(admin: httpx.Client) -> None:
    a_map(admin), a_map(admin)
    cursor = ok(admin.get("/v1/maps?limit=1"))["next_cursor"]
    ok(admin.get("/v1/maps", params={"limit": 2, "cursor": cursor}))
    refused(admin.get("/v1/maps", params={"site": "x", "cursor": cursor}), 422, "invalid-request")
    refused(admin.get("/v1/jobs", params={"cursor": cursor}), 422, "invalid-request")


def test_a_key_sees_its_maps_alone(admin: httpx.Client, client_for: ClientFor) -> None:
    mine, other = a_map(admin), a_map(admin)
    robot = client_for("robot", [mine])
    assert [m["id"] for m in ok(robot.get("/v1/maps"))["items"]] == [mine]
    ok(robot.get(f"/v1/maps/{mine}"))
    foreign = refused(robot.get(f"/v1/maps/{other}"), 404, "map-not-found")
    missing = refused(robot.get("/v1/maps/map_none"), 404, "map-not-found")
    assert foreign["detail"].replace(other, "map_none") == missing["detail"]


@pytest.mark.parametrize(
    ("body", "pointer"),
    [
        ({"site": "A"}, "#/name"),
        ({"site": "A", "name": ""}, "#/name"),
        ({"site": "A", "name": "   "}, "#/name"),
        ({"site": "A", "name": "n" * 201}, "#/name"),
        ({"site": "A", "name": 7}, "#/name"),
        ({"site": "A", "name": "a\x00b"}, "#/name"),
        ({"site": "A", "name": "b", "a/b~c": 1}, "#/a~1b~0c"),
        ([], "#"),
    ],
)
def test_a_wrong_body_is_pointed_at(admin: httpx.Client, body: object, pointer: str) -> None:
    problem = refused(admin.post("/v1/maps", json=body), 422, "invalid-request")
    assert [place["pointer"] for place in problem["errors"]] == [pointer]
    assert problem["errors"][0]["detail"]


@pytest.mark.parametrize("body", [b"{", b"\xff", b'{"site": "\\ud800", "name": "b"}', b"", b"NaN"])
def test_a_body_that_is_no_json_is_refused(admin: httpx.Client, body: bytes) -> None:
    answer = admin.post("/v1/maps", content=body, headers={"Content-Type": "application/json"})
    refused(answer, 422, "invalid-request")
