"""Drawings and scans in one piece."""

from __future__ import annotations

import hashlib
import socket
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests import files, web
from tests.patience import soon
from tests.server import ClientFor, Server

PNG = files.png()
PLY = files.ply(files.room())


@pytest.fixture(scope="module")
def map_id(admin: httpx.Client) -> str:
    made = admin.post("/v1/maps", json={"site": "plant", "name": "uploads"})
    assert made.status_code == 201, made.text
    identifier: str = made.json()["id"]
    return identifier


@pytest.fixture(scope="module")
def tablet(client_for: ClientFor) -> httpx.Client:
    return client_for("tablet")


def send_drawing(client: httpx.Client, map_id: str, content: bytes = PNG, **more: Any) -> httpx.Response:
    name = more.pop("name", "office.png")
    return client.post(f"/v1/maps/{map_id}/drawings", files={"file": (name, content)}, **more)


def send_scan(client: httpx.Client, map_id: str, content: bytes = PLY, **more: Any) -> httpx.Response:
    return client.post(f"/v1/maps/{map_id}/scans", files={"file": ("room.ply", content)}, **more)


def problem(answer: httpx.Response, status: int, slug: str) -> dict[str, Any]:
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    body: dict[str, Any] = answer.json()
    assert body["type"].endswith(f"/problems/{slug}"), body
    assert body["status"] == status
    return body


def leftovers(server: Server) -> list[Path]:
    return sorted((server.settings.data_dir / "blobs" / ".tmp").iterdir())


def test_a_drawing_is_stored_and_its_job_queued(server: Server, tablet: httpx.Client, map_id: str) -> None:
    answer = send_drawing(tablet, map_id, data={"metres_per_unit": "0.02", "page": "1"})
    assert answer.status_code == 202, answer.text
    drawing, job = answer.json()["drawing"], answer.json()["job"]
    sha256 = hashlib.sha256(PNG).hexdigest()
    assert answer.headers["location"] == f"/v1/drawings/{drawing['id']}"
    assert (drawing["sha256"], drawing["size_bytes"]) == (sha256, len(PNG))
    assert (drawing["file_name"], drawing["media_type"]) == ("office.png", "image/png")
    assert drawing["options"] == {"page": 1, "scale": {"metres_per_unit": 0.02}}
    assert drawing["reading"] is None
    assert drawing["files"] == dict.fromkeys(("preview", "walls", "removed", "sheet", "tiles"))
    assert (job["kind"], job["state"], job["subject_id"]) == ("read-drawing", "queued", drawing["id"])
    assert tablet.get(answer.headers["location"]).json() == drawing
    assert tablet.get(f"/v1/jobs/{job['id']}").json() == job
    assert server.kernel.blobs.path(sha256).read_bytes() == PNG
    assert leftovers(server) == []


@pytest.mark.parametrize(
    ("fields", "scale"),
    [
        ({}, None),
        ({"ratio": "1:100", "dpi": "300"}, {"ratio": 100.0, "dpi": 300.0}),
        (
            {"known_length": "0,0,30,40,5"},
            {"known_length": {"x1": 0.0, "y1": 0.0, "x2": 30.0, "y2": 40.0, "length_m": 5.0}},
        ),
        ({"scale": '{"metres_per_unit": 0.5}'}, {"metres_per_unit": 0.5}),
    ],
)
def test_every_way_to_say_the_scale(
    tablet: httpx.Client, map_id: str, fields: dict[str, str], scale: dict[str, Any] | None
) -> None:
    answer = send_drawing(tablet, map_id, data=fields)
    assert answer.status_code == 202, answer.text
    assert answer.json()["drawing"]["options"].get("scale") == scale


@pytest.mark.parametrize(
    ("fields", "pointer"),
    [
        ({"metres_per_unit": "nan"}, "#/metres_per_unit"),
        ({"metres_per_unit": "0"}, "#/scale"),
        ({"metres_per_unit": "1e400"}, "#/metres_per_unit"),
        ({"ratio": "100"}, "#/scale"),
        ({"known_length": "1,2,3"}, "#/known_length"),
        ({"known_length": "1,2,1,2,3"}, "#/scale"),
        ({"scale": "{"}, "#/scale"),
        ({"scale": "[1]"}, "#/scale"),
        ({"scale": '{"metres_per_unit": 1' + "0" * 400 + "}"}, "#/scale/metres_per_unit"),
        ({"scale": '{"metres_per_unit": 1}', "dpi": "3"}, "#/scale"),
        ({"page": "0"}, "#/page"),
        ({"page": "two"}, "#/page"),
        ({"crop": "1,2,3,4"}, "#/crop"),
        ({"colour": "red"}, "#/colour"),
    ],
)
def test_a_wrong_field_is_named(
    server: Server, tablet: httpx.Client, map_id: str, fields: dict[str, str], pointer: str
) -> None:
    body = problem(send_drawing(tablet, map_id, data=fields), 422, "invalid-request")
    assert [error["pointer"] for error in body["errors"]] == [pointer]
    assert leftovers(server) == []


def test_a_scan_with_and_without_a_rough_pose(tablet: httpx.Client, map_id: str) -> None:
    answer = send_scan(tablet, map_id)
    assert answer.status_code == 202, answer.text
    scan = answer.json()["scan"]
    assert (scan["rough_pose"], scan["media_type"]) == (None, "application/vnd.groundplan.ply")
    assert answer.json()["job"]["kind"] == "read-scan"
    posed = send_scan(tablet, map_id, data={"rough_pose": '{"x_m": 1, "y_m": -2.5, "yaw_rad": 0.1}'})
    assert posed.json()["scan"]["rough_pose"] == {"x_m": 1.0, "y_m": -2.5, "z_m": 0.0, "yaw_rad": 0.1}
    assert tablet.get(posed.headers["location"]).json() == posed.json()["scan"]
    for wrong in ('{"x_m": 1}', '{"x_m": 1, "y_m": NaN}', '{"x_m": 1, "y_m": 2, "roll_rad": 0}', "here"):
        problem(send_scan(tablet, map_id, data={"rough_pose": wrong}), 422, "invalid-request")


def test_a_scans_up_axis_and_unit_may_be_said(tablet: httpx.Client, map_id: str) -> None:
    sent = send_scan(tablet, map_id, data={"up": "-y", "unit": "mm"})
    assert sent.json()["scan"]["options"] == {"up": "-y", "metres_per_unit": 0.001}
    for wrong, pointer in (({"up": "w"}, "#/up"), ({"unit": "parsec"}, "#/unit"), ({"down": "z"}, "#/down")):
        refused = problem(send_scan(tablet, map_id, data=wrong), 422, "invalid-request")
        assert refused["errors"][0]["pointer"] == pointer


def test_the_file_s_bytes_decide_and_the_advice_fits(
    server: Server, tablet: httpx.Client, map_id: str
) -> None:
    text = problem(send_drawing(tablet, map_id, b"hello, this is text\n"), 415, "unsupported-media")
    assert "text file" in text["detail"]
    gif = problem(send_drawing(tablet, map_id, b"GIF89a..."), 415, "unsupported-media")
    assert "GIF" in gif["detail"]
    assert "save it as PNG" in gif["detail"]
    assert send_drawing(tablet, map_id, b"%PDF-1.7\n...").json()["drawing"]["media_type"] == "application/pdf"
    swapped = problem(send_drawing(tablet, map_id, PLY), 415, "unsupported-media")
    assert "Upload it as a scan" in swapped["detail"]
    problem(send_drawing(tablet, map_id, b""), 422, "file-empty")
    assert send_drawing(tablet, map_id, PNG, name="scan.ply").status_code == 202
    assert leftovers(server) == []


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"--b\r\n\r\n",
        b'--b\r\nContent-Disposition: form-data; name="file"; filename="a.png"\r\n\r\n' + PNG,
        b'--b\r\nContent-Disposition: form-data; name="page"\r\n\r\n1\r\n--b--\r\n',
        b'--b\r\nContent-Disposition: form-data; name="file"\r\n\r\nabc\r\n--b--\r\n',
        b'--b\r\nContent-Disposition: form-data; name="f"; filename="a"\r\n\r\nabc\r\n--b--\r\n',
        b'--b\r\nX: form-data; name="file"\r\n\r\nabc\r\n--b--\r\n',
        b'--b\r\nContent-Disposition: form-data; name="page"\r\n\r\n\xff\r\n--b--\r\n',
        b'--b\r\nContent-Disposition: form-data; name="a"\r\n\r\n' + b"9" * 70_000,
        b"--b\r\n" + b"X: " + b"9" * 10_000 + b"\r\n\r\n",
        b"no form at all",
    ],
)
def test_a_broken_form_is_refused(server: Server, tablet: httpx.Client, map_id: str, body: bytes) -> None:
    answer = tablet.post(
        f"/v1/maps/{map_id}/drawings",
        content=body,
        headers={"content-type": "multipart/form-data; boundary=b"},
    )
    problem(answer, 422, "invalid-request")
    assert leftovers(server) == []


def test_what_is_no_form_is_refused(tablet: httpx.Client, map_id: str) -> None:
    problem(tablet.post(f"/v1/maps/{map_id}/drawings", json={"file": 1}), 415, "unsupported-media")


def test_two_files_or_too_many_fields_are_refused(tablet: httpx.Client, map_id: str) -> None:
    two = tablet.post(
        f"/v1/maps/{map_id}/drawings", files=[("file", ("a.png", PNG)), ("file", ("b.png", PNG))]
    )
    problem(two, 422, "invalid-request")
    many = {f"field{n}": "1" for n in range(20)}
    problem(send_drawing(tablet, map_id, data=many), 422, "invalid-request")


def test_the_same_key_gives_the_same_answer_and_one_drawing(
    tablet: httpx.Client, admin: httpx.Client
) -> None:
    map_id = admin.post("/v1/maps", json={"site": "plant", "name": "idempotent"}).json()["id"]
    key = {"Idempotency-Key": "drawing-1"}
    first = send_drawing(tablet, map_id, headers=key, data={"page": "1"})
    again = send_drawing(tablet, map_id, headers=key, data={"page": "1"})
    assert (again.status_code, again.content) == (first.status_code, first.content)
    for other in ({"page": "2"}, {}):
        problem(send_drawing(tablet, map_id, headers=key, data=other), 422, "idempotency-key-reused")
    problem(
        send_drawing(tablet, map_id, files.png(seed=1), headers=key, data={"page": "1"}),
        422,
        "idempotency-key-reused",
    )
    listed = tablet.get(f"/v1/maps/{map_id}/drawings").json()
    assert [row["id"] for row in listed["items"]] == [first.json()["drawing"]["id"]]


def test_lists_are_paged(tablet: httpx.Client, admin: httpx.Client) -> None:
    map_id = admin.post("/v1/maps", json={"site": "plant", "name": "paged"}).json()["id"]
    made = [send_scan(tablet, map_id).json()["scan"]["id"] for _ in range(5)]
    seen, cursor = [], None
    while True:
        params = {"limit": 2} | ({} if cursor is None else {"cursor": cursor})
        page = tablet.get(f"/v1/maps/{map_id}/scans", params=params).json()
        seen += [row["id"] for row in page["items"]]
        cursor = page["next_cursor"]
        if cursor is None:
            break
    assert seen == made


def test_a_key_sees_and_uploads_to_its_own_maps_only(
    client_for: ClientFor, tablet: httpx.Client, admin: httpx.Client, map_id: str
) -> None:
    elsewhere = admin.post("/v1/maps", json={"site": "plant", "name": "elsewhere"}).json()["id"]
    stranger, robot = client_for("tablet", [elsewhere]), client_for("robot")
    drawing = send_drawing(tablet, map_id).json()["drawing"]["id"]
    scan = send_scan(tablet, map_id).json()["scan"]["id"]
    problem(send_drawing(stranger, map_id), 404, "map-not-found")
    problem(stranger.get(f"/v1/maps/{map_id}/drawings"), 404, "map-not-found")
    problem(stranger.get(f"/v1/drawings/{drawing}"), 404, "drawing-not-found")
    problem(stranger.patch(f"/v1/drawings/{drawing}", json={"page": 2}), 404, "drawing-not-found")
    problem(stranger.get(f"/v1/drawings/{drawing}/preview.png"), 404, "drawing-not-found")
    problem(stranger.get(f"/v1/scans/{scan}"), 404, "scan-not-found")
    problem(stranger.get(f"/v1/scans/{scan}/points"), 404, "scan-not-found")
    problem(send_drawing(robot, map_id), 403, "forbidden")
    problem(send_drawing(tablet, "map_none"), 404, "map-not-found")
    problem(
        web.post(f"{tablet.base_url}/v1/maps/{map_id}/scans", files={"file": b""}),
        401,
        "unauthenticated",
    )


def test_files_that_are_not_there_yet_say_why(tablet: httpx.Client, map_id: str) -> None:
    drawing = send_drawing(tablet, map_id).json()["drawing"]["id"]
    body = problem(tablet.get(f"/v1/drawings/{drawing}/walls.geojson"), 404, "artifact-not-found")
    assert body["job_state"] == "queued"
    problem(tablet.get(f"/v1/drawings/{drawing}/secrets.txt"), 404, "artifact-not-found")


def test_another_scale_asks_for_another_reading(tablet: httpx.Client, map_id: str) -> None:
    sent = send_drawing(tablet, map_id, data={"page": "2"}).json()
    at = f"/v1/drawings/{sent['drawing']['id']}"
    changed = tablet.patch(at, json={"scale": {"metres_per_unit": 0.03}})
    assert changed.status_code == 202, changed.text
    assert changed.json()["drawing"]["options"] == {"page": 2, "scale": {"metres_per_unit": 0.03}}
    assert changed.json()["job"]["id"] != sent["job"]["id"]
    assert changed.json()["job"]["state"] == "queued"
    assert tablet.get(f"/v1/jobs/{sent['job']['id']}").json()["state"] == "cancelled"
    assert tablet.get(at).json() == changed.json()["drawing"]
    for wrong, pointer in (
        ({}, "#"),
        ({"crop": [0, 0, 1, 1]}, "#/crop"),
        ({"scale": {"metres_per_unit": 1, "ratio": 2, "dpi": 3}}, "#/scale"),
        ({"page": "2"}, "#/page"),
    ):
        body = problem(tablet.patch(at, json=wrong), 422, "invalid-request")
        assert [error["pointer"] for error in body["errors"]] == [pointer], body
    assert tablet.get(at).json() == changed.json()["drawing"]


def test_a_client_that_goes_away_leaves_nothing(server: Server, tablet: httpx.Client, map_id: str) -> None:
    before = tablet.get(f"/v1/maps/{map_id}/scans", params={"limit": 200}).json()
    address = (str(tablet.base_url.host), int(tablet.base_url.port or 0))
    head = (
        f"POST /v1/maps/{map_id}/scans HTTP/1.1\r\nHost: x\r\n"
        f"Authorization: {tablet.headers['Authorization']}\r\n"
        "Content-Type: multipart/form-data; boundary=b\r\nContent-Length: 10000000\r\n\r\n"
        '--b\r\nContent-Disposition: form-data; name="file"; filename="a.ply"\r\n\r\n'
    ).encode()
    with socket.create_connection(address) as connection:
        connection.sendall(head + PLY)
        soon(lambda: leftovers(server))
    soon(lambda: not leftovers(server))
    assert tablet.get(f"/v1/maps/{map_id}/scans", params={"limit": 200}).json() == before
    assert "Traceback" not in server.log.read_text()


def test_an_early_answer_reaches_a_client_that_is_sending(tablet: httpx.Client, map_id: str) -> None:
    body = files.form(files.zeros(30_000_000))
    answer = tablet.post(
        f"/v1/maps/{map_id}/scans",
        content=body,
        headers={"content-type": "multipart/form-data; boundary=b0undary"},
    )
    problem(answer, 415, "unsupported-media")
    assert answer.headers["connection"] == "close"
    unknown = tablet.post(
        "/v1/maps/map_none/scans",
        content=files.form(files.zeros(30_000_000)),
        headers={"content-type": "multipart/form-data; boundary=b0undary"},
    )
    problem(unknown, 404, "map-not-found")


def test_the_form_is_documented(server: Server) -> None:
    document = web.get(f"{server.url}/openapi.json").json()
    for kind, fields in (
        ("drawings", {"file", "scale", "page"}),
        ("scans", {"file", "rough_pose", "up", "unit"}),
    ):
        body = document["paths"][f"/v1/maps/{{map_id}}/{kind}"]["post"]["requestBody"]
        form = body["content"]["multipart/form-data"]["schema"]
        assert form["required"] == ["file"]
        assert fields <= set(form["properties"])
