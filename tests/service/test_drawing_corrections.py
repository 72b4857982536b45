"""A person's corrections over HTTP: sent, shown, replayed on a new issue of the drawing."""

from __future__ import annotations

import io
import json
import signal
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
from PIL import Image, ImageDraw

from tests.forked import forked
from tests.patience import PATIENCE_S
from tests.server import Server, environment
from tests.service.asking import a_map, ended, ok, refused

EXCLUDE = {"action": "exclude", "within": [[0.0, 0.0], [90.0, 0.0], [90.0, 40.0]]}
ADD = {"action": "add-wall", "line": [[300.0, 160.0], [300.0, 440.0]], "thickness_m": 0.3}
WRONG = [
    ("here", "#/edits"),
    ([7], "#/edits/0"),
    ([{"action": "paint"}], "#/edits/0/action"),
    ([EXCLUDE, {"action": "exclude"}], "#/edits/1/within"),
    ([{**EXCLUDE, "line": []}], "#/edits/0/line"),
    ([{"action": "exclude", "within": [[0, 0], [1, 1]]}], "#/edits/0/within"),
    ([{"action": "exclude", "within": [[0, 0], [1, 1], [1, None]]}], "#/edits/0/within/2/1"),
    ([{"action": "exclude", "within": [[0, 0], [1, 1], [1, 1e13]]}], "#/edits/0/within/2/1"),
    ([{"action": "move", "to": "wall"}], "#/edits/0"),
    ([{"action": "move", "strokes": ["s1"], "to": "wall"}], "#/edits/0/strokes/0"),
    ([{"action": "move", "strokes": ["s1.0_2.0_3.0_4.0"], "to": "sky"}], "#/edits/0/to"),
    ([{**ADD, "thickness_m": 0}], "#/edits/0/thickness_m"),
    ([EXCLUDE] * 501, "#/edits"),
]


@pytest.fixture(scope="module")
def worker(server: Server) -> Iterator[None]:
    process = forked("worker", env=environment(server.settings))
    yield
    process.send_signal(signal.SIGTERM)
    process.wait(timeout=PATIENCE_S)


def a_room(*, bench_at: int = 250) -> bytes:
    """Return a PNG of one room in filled walls, 2 cm a pixel, with a free bench."""
    image = Image.new("L", (640, 600), 255)
    pen = ImageDraw.Draw(image)
    pen.rectangle((100, 100, 540, 500), outline=0, width=12)
    pen.rectangle((bench_at, 300, bench_at + 60, 312), outline=0, width=2)
    file = io.BytesIO()
    image.save(file, format="PNG")
    return file.getvalue()


def send(client: httpx.Client, map_id: str, content: bytes, **fields: str) -> httpx.Response:
    return client.post(f"/v1/maps/{map_id}/drawings", files={"file": ("room.png", content)}, data=fields)


def read(client: httpx.Client, answer: httpx.Response) -> dict[str, Any]:
    """Return the drawing once its job has succeeded."""
    accepted = ok(answer, 202)
    job = ended(client, accepted["job"]["id"])
    assert job["state"] == "succeeded", job
    return ok(client.get(f"/v1/drawings/{accepted['drawing']['id']}"))


def features(client: httpx.Client, drawing: dict[str, Any], name: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = ok(client.get(drawing["files"][name]))["features"]
    return found


@pytest.mark.parametrize(("edits", "pointer"), WRONG)
def test_a_wrong_edit_is_named(admin: httpx.Client, edits: object, pointer: str) -> None:
    map_id = a_map(admin)
    said = refused(send(admin, map_id, a_room(), edits=json.dumps(edits)), 422, "invalid-request")
    assert [error["pointer"] for error in said["errors"]] == [pointer]
    drawing = ok(send(admin, map_id, a_room()), 202)["drawing"]["id"]
    problem = refused(admin.patch(f"/v1/drawings/{drawing}", json={"edits": edits}), 422, "invalid-request")
    assert problem["errors"][0]["pointer"].startswith("#/edits")


def test_edits_replace_the_whole_list_and_null_takes_them_back(admin: httpx.Client) -> None:
    sent = ok(send(admin, a_map(admin), a_room(), edits=json.dumps([EXCLUDE, ADD]), page="1"), 202)
    at = f"/v1/drawings/{sent['drawing']['id']}"
    assert sent["drawing"]["options"] == {"page": 1, "edits": [EXCLUDE, ADD]}
    ok(admin.patch(at, json={"edits": [ADD]}), 202)
    assert ok(admin.get(at))["options"] == {"page": 1, "edits": [ADD]}
    ok(
        admin.patch(at, json={"wall_layers": ["A-WALL"], "storey": "1", "cut_height_m": 1.2, "page": None}),
        202,
    )
    ok(admin.patch(at, json={"edits": []}), 202)
    options = ok(admin.get(at))["options"]
    assert options == {"wall_layers": ["A-WALL"], "storey": "1", "cut_height_m": 1.2}


def test_a_new_issue_takes_over_what_was_said_of_the_old_one(admin: httpx.Client) -> None:
    map_id = a_map(admin)
    said = {"metres_per_unit": "0.02", "edits": json.dumps([ADD]), "wall_layers": '["A-WALL"]'}
    old = ok(send(admin, map_id, a_room(), **said), 202)["drawing"]
    new = ok(send(admin, map_id, a_room(bench_at=300), replaces=old["id"], metres_per_unit="0.03"), 202)
    taken = {**old["options"], "scale": {"metres_per_unit": 0.03}, "replaces": old["id"]}
    assert new["drawing"]["options"] == taken
    for where, wrong in ((map_id, "drw_none"), (a_map(admin), old["id"])):
        problem = refused(send(admin, where, a_room(), replaces=wrong), 422, "invalid-request")
        assert [error["pointer"] for error in problem["errors"]] == ["#/replaces"]
    at = f"/v1/drawings/{new['drawing']['id']}"
    problem = refused(admin.patch(at, json={"replaces": "drw_none"}), 422, "invalid-request")
    assert [error["pointer"] for error in problem["errors"]] == ["#/replaces"]


@pytest.mark.usefixtures("worker")
def test_a_correction_is_applied_and_a_new_issue_says_which_no_longer_fits(admin: httpx.Client) -> None:
    map_id = a_map(admin)
    drawing = read(admin, send(admin, map_id, a_room(), metres_per_unit="0.02"))
    at = f"/v1/drawings/{drawing['id']}"
    walls = features(admin, drawing, "walls")
    assert all(w["properties"]["id"] and w["properties"]["reason"] for w in walls)
    bench = [
        f
        for f in features(admin, drawing, "removed")
        if all(5.0 - 0.1 <= x <= 6.2 + 0.1 for line in f["geometry"]["coordinates"] for x, _ in line)
    ]
    names = [f["properties"]["id"] for f in bench]
    assert names
    edits = [{"action": "move", "strokes": names, "to": "wall"}, ADD]
    edited = read(admin, admin.patch(at, json={"edits": edits}))
    assert edited["options"]["edits"] == edits
    assert edited["reading"]["counts"]["edits_applied"] == 2
    reasons = [w["properties"]["reason"] for w in features(admin, edited, "walls")]
    assert reasons.count("added by a person") == 1
    assert reasons.count("moved by a person") >= 1
    assert not set(names) & {f["properties"]["id"] for f in features(admin, edited, "removed")}

    new = read(admin, send(admin, map_id, a_room(bench_at=420), replaces=drawing["id"]))
    assert new["options"]["scale"] == {"metres_per_unit": 0.02}
    told = [f for f in new["reading"]["findings"] if f["code"] == "edit-does-not-fit"]
    assert [f["values"] for f in told] == [{"edit": 0, "action": "move"}]
    assert "added by a person" in [w["properties"]["reason"] for w in features(admin, new, "walls")]
