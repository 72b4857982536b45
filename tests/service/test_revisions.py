"""Revisions and placements over HTTP, the worker's part played by hand."""

from __future__ import annotations

from typing import Any

import httpx
import pytest
from sqlalchemy import select

from service.db.models import Revision
from service.domain.recipe import Recipe
from service.domain.rough_pose import RoughPose
from tests.server import Server
from tests.service.asking import a_map, a_placement, a_ready_revision, ok, refused
from tests.service.by_hand import IDENTITY, SEEN_BY_HAND, ByHand
from tests.unit.placement_evidence import GOOD


def test_a_revision_is_asked_for_built_and_shown(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id = a_map(admin)
    drawing_id = by_hand.drawing(map_id)
    body = {"drawing_id": drawing_id, "recipe": {"voxel_size_m": 0.1, "map_from_drawing": {"yaw_rad": 0.5}}}
    answer = admin.post(f"/v1/maps/{map_id}/revisions", json=body)
    made = ok(answer, 202)
    assert answer.headers["location"] == f"/v1/maps/{map_id}/revisions/1"
    assert (made["revision"]["n"], made["revision"]["status"]) == (1, "building")
    assert (made["job"]["kind"], made["job"]["state"]) == ("build-revision", "queued")
    wanted = Recipe(voxel_size_m=0.1).to_json()
    assert made["revision"]["recipe"] == wanted | {
        "map_from_drawing": {"x_m": 0.0, "y_m": 0.0, "yaw_rad": 0.5}
    }
    where = f"/v1/maps/{map_id}/revisions/1"
    problem = refused(admin.get(f"{where}/artifacts"), 409, "revision-not-ready")
    assert (problem["status"], problem["job_id"]) == (409, made["job"]["id"])
    by_hand.build(made["job"]["id"])
    shown = ok(admin.get(where))
    assert (shown["status"], shown["report"]["frame"]) == ("ready", "map")
    assert ok(admin.get(f"/v1/jobs/{made['job']['id']}"))["state"] == "succeeded"
    assert [a["path"] for a in ok(admin.get(f"{where}/artifacts"))["items"]] == [
        "point-cloud.pcd",
        "preview.png",
        "report.json",
    ]


def test_a_base_gives_what_the_body_leaves_out(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id = a_map(admin)
    first = a_ready_revision(admin, by_hand, map_id, recipe={"voxel_size_m": 0.2, "floor": True})
    placement_id = a_placement(admin, by_hand, map_id)
    layers = [{"placement_id": placement_id, "name": "machine"}]
    second = a_ready_revision(admin, by_hand, map_id, base=first, layers=layers)
    third = a_ready_revision(admin, by_hand, map_id, base=second, recipe={"ceiling": True})
    shown = ok(admin.get(f"/v1/maps/{map_id}/revisions/{third}"))
    assert shown["parent_n"] == second
    assert (shown["recipe"]["voxel_size_m"], shown["recipe"]["floor"], shown["recipe"]["ceiling"]) == (
        0.2,
        True,
        True,
    )
    assert [(x["name"], x["placement_id"]) for x in shown["layers"]] == [("machine", placement_id)]
    bare = a_ready_revision(admin, by_hand, map_id, base=third, layers=[])
    assert ok(admin.get(f"/v1/maps/{map_id}/revisions/{bare}"))["layers"] == []
    listed = ok(admin.get(f"/v1/maps/{map_id}/revisions?limit=3"))
    assert [r["n"] for r in listed["items"]] == [4, 3, 2]
    more = ok(admin.get(f"/v1/maps/{map_id}/revisions", params={"limit": 3, "cursor": listed["next_cursor"]}))
    assert ([r["n"] for r in more["items"]], more["next_cursor"]) == ([1], None)


def test_a_drawing_read_anew_changes_no_revision(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id = a_map(admin)
    drawing_id = by_hand.drawing(map_id)
    first = a_ready_revision(admin, by_hand, map_id, drawing_id=drawing_id)
    by_hand.reread(drawing_id, walls=b"other walls")
    second = a_ready_revision(admin, by_hand, map_id, base=first, recipe={"floor": True})
    third = a_ready_revision(admin, by_hand, map_id, base=second, drawing_id=drawing_id)
    with by_hand.kernel.db.reading() as session:
        rows = session.scalars(select(Revision).where(Revision.map_id == map_id).order_by(Revision.n)).all()
        held = [(row.n, row.walls_sha256, row.scale["metres_per_unit"]) for row in rows]
    earlier, later = by_hand.keep(b"walls.geojson").sha256, by_hand.keep(b"other walls").sha256
    assert held == [(first, earlier, 0.05), (second, earlier, 0.05), (third, later, 0.07)]


def test_a_base_has_to_be_there_and_not_to_have_failed(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id = a_map(admin)
    where = f"/v1/maps/{map_id}/revisions"
    refused(admin.post(where, json={"base": 1}), 404, "revision-not-found")
    first = a_ready_revision(admin, by_hand, map_id)
    second = ok(admin.post(where, json={"base": first}), 202)
    by_hand.fail(second["job"]["id"], problem={"slug": "job-crashed", "title": "t", "detail": "d"})
    assert ok(admin.get(f"{where}/2"))["status"] == "failed"
    refused(admin.post(where, json={"base": 2}), 409, "revision-not-ready")
    third = ok(admin.post(where, json={"base": first}), 202)
    assert (third["revision"]["n"], third["revision"]["parent_n"], third["rebased"]) == (3, first, None)


def test_a_drawing_has_to_be_read_and_scaled(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id, other = a_map(admin), a_map(admin)
    where = f"/v1/maps/{map_id}/revisions"
    problem = refused(admin.post(where, json={}), 422, "invalid-request")
    assert problem["errors"][0]["pointer"] == "#/drawing_id"
    unread = by_hand.drawing(map_id, read=False)
    assert refused(admin.post(where, json={"drawing_id": unread}), 409, "drawing-not-read")["job_id"]
    unscaled = by_hand.drawing(map_id, scaled=False)
    refused(admin.post(where, json={"drawing_id": unscaled}), 422, "scale-unknown")
    refused(admin.post(where, json={"drawing_id": by_hand.drawing(other)}), 404, "drawing-not-found")
    assert ok(admin.get(where))["items"] == []


@pytest.mark.parametrize(
    ("recipe", "pointer"),
    [
        ({"voxel_size_m": 0}, "#/recipe/voxel_size_m"),
        ({"voxel_size_m": "0.1"}, "#/recipe/voxel_size_m"),
        ({"voxel_size_m": True}, "#/recipe/voxel_size_m"),
        ({"floor": 1}, "#/recipe/floor"),
        ({"colour": "red"}, "#/recipe/colour"),
        ({"map_from_drawing": {"x": 1}}, "#/recipe/map_from_drawing/x"),
    ],
)
def test_a_wrong_recipe_is_pointed_at(admin: httpx.Client, recipe: dict[str, Any], pointer: str) -> None:
    answer = admin.post(f"/v1/maps/{a_map(admin)}/revisions", json={"drawing_id": "drw_x", "recipe": recipe})
    assert refused(answer, 422, "invalid-request")["errors"][0]["pointer"] == pointer


@pytest.mark.parametrize("number", [b"NaN", b"Infinity", b"-Infinity", b"1e999"])
def test_a_number_that_is_none_is_refused(admin: httpx.Client, number: bytes) -> None:
    body = b'{"drawing_id": "drw_x", "recipe": {"map_from_drawing": {"x_m": ' + number + b"}}}"
    answer = admin.post(
        f"/v1/maps/{a_map(admin)}/revisions", content=body, headers={"Content-Type": "application/json"}
    )
    problem = refused(answer, 422, "invalid-request")
    assert problem["errors"][0]["pointer"] == "#/recipe/map_from_drawing/x_m"


def test_a_scan_is_placed_and_taken_in(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id = a_map(admin)
    first = a_ready_revision(admin, by_hand, map_id)
    scan_id = by_hand.scan(map_id, rough_pose=RoughPose(3.0, 4.0, 0.0, 0.1))
    asked = ok(admin.post(f"/v1/scans/{scan_id}/placements", json={}), 202)
    placement = asked["placement"]
    assert (placement["revision"], placement["verdict"], placement["T_map_scan"]) == (first, None, None)
    assert placement["initial_pose"] == {"x_m": 3.0, "y_m": 4.0, "z_m": 0.0, "yaw_rad": 0.1}
    where = f"/v1/placements/{placement['id']}"
    refused(admin.post(f"{where}/accept"), 409, "placement-not-acceptable")
    by_hand.place(asked["job"]["id"])
    done = ok(admin.get(where))
    assert (done["verdict"], done["T_map_scan"]) == ("accepted", IDENTITY)
    assert done["evidence"] == GOOD.to_json()
    made = ok(admin.post(f"{where}/accept"), 202)
    assert (made["revision"]["n"], made["revision"]["parent_n"]) == (2, first)
    assert [(x["name"], x["scan_id"]) for x in made["revision"]["layers"]] == [("scan.ply", scan_id)]
    by_hand.build(made["job"]["id"])
    refused(admin.post(f"{where}/accept"), 409, "placement-not-acceptable")
    again = ok(admin.post(f"/v1/scans/{scan_id}/placements", json={"rough_pose": {"x_m": 0, "y_m": 0}}), 202)
    by_hand.place(again["job"]["id"])
    moved = ok(admin.post(f"/v1/placements/{again['placement']['id']}/accept", json={"name": "moved"}), 202)
    layers = [(x["name"], x["placement_id"]) for x in moved["revision"]["layers"]]
    assert layers == [("moved", again["placement"]["id"])]
    listed = ok(admin.get(f"/v1/scans/{scan_id}/placements"))["items"]
    assert [p["id"] for p in listed] == [again["placement"]["id"], placement["id"]]


@pytest.mark.parametrize(
    ("verdict", "body", "status"),
    [
        ("rejected", {"reviewed": True}, 409),
        ("needs-review", None, 409),
        ("needs-review", {"reviewed": False}, 409),
        ("needs-review", {"reviewed": True}, 202),
        ("accepted", {}, 202),
    ],
)
def test_the_verdict_decides(
    admin: httpx.Client, by_hand: ByHand, verdict: str, body: dict[str, Any] | None, status: int
) -> None:
    map_id = a_map(admin)
    a_ready_revision(admin, by_hand, map_id)
    placement_id = a_placement(admin, by_hand, map_id, verdict=verdict)
    where = f"/v1/placements/{placement_id}/accept"
    answer = admin.post(where) if body is None else admin.post(where, json=body)
    assert answer.status_code == status, answer.text
    if status == 409:
        problem = refused(answer, 409, "placement-not-acceptable")
        assert (problem["verdict"], problem["reasons"]) == (verdict, [SEEN_BY_HAND.to_json()])


def test_what_a_placement_needs(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id = a_map(admin)
    pose = {"rough_pose": {"x_m": 1, "y_m": 1}}
    where = f"/v1/scans/{by_hand.scan(map_id)}/placements"
    refused(admin.post(where, json=pose), 409, "revision-not-ready")
    a_ready_revision(admin, by_hand, map_id)
    both = refused(admin.post(where, json=pose | {"search": True}), 422, "invalid-request")
    assert both["errors"][0]["pointer"] == "#/search"
    for everywhere in ({}, {"search": True}):
        assert ok(admin.post(where, json=everywhere), 202)["placement"]["initial_pose"] is None
    refused(admin.post(where, json=pose | {"revision": 9}), 404, "revision-not-found")
    unread = by_hand.scan(map_id, read=False)
    refused(admin.post(f"/v1/scans/{unread}/placements", json=pose), 409, "scan-not-read")


def test_layers_have_to_be_of_the_map(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id, other = a_map(admin), a_map(admin)
    first = a_ready_revision(admin, by_hand, map_id)
    a_ready_revision(admin, by_hand, other)
    foreign = {"placement_id": a_placement(admin, by_hand, other)}
    mine = {"placement_id": a_placement(admin, by_hand, map_id)}
    where = f"/v1/maps/{map_id}/revisions"
    refused(admin.post(where, json={"base": first, "layers": [foreign]}), 404, "placement-not-found")
    twice = refused(admin.post(where, json={"base": first, "layers": [mine, mine]}), 422, "invalid-request")
    assert twice["errors"][0]["pointer"] == "#/layers/1/placement_id"
    doubtful = {"placement_id": a_placement(admin, by_hand, map_id, verdict="needs-review")}
    body = {"base": first, "layers": [mine, doubtful]}
    refused(admin.post(where, json=body), 409, "placement-not-acceptable")
    body["layers"] = [mine, doubtful | {"reviewed": True}]
    assert len(ok(admin.post(where, json=body), 202)["revision"]["layers"]) == 2


@pytest.mark.postgres
def test_the_loop_holds_on_postgres(postgres_served: Server) -> None:
    admin = postgres_served.client(postgres_served.admin_key)
    by_hand = ByHand(postgres_served.kernel)
    map_id = a_map(admin)
    a_ready_revision(admin, by_hand, map_id)
    placement_id = a_placement(admin, by_hand, map_id)
    made = ok(admin.post(f"/v1/placements/{placement_id}/accept"), 202)
    by_hand.build(made["job"]["id"])
    published = ok(admin.post(f"/v1/maps/{map_id}/revisions/2/publish", json={}))
    assert published["revision"] == 2
    with admin.stream("GET", published["artifacts"][0]["url"]) as answer:
        assert answer.status_code == 200
