"""Uploads in pieces: tus 1.0 against the real service."""

from __future__ import annotations

import json
import os
import threading
import time
from pathlib import Path

import httpx
import pytest

from service.settings import Settings
from service.storage.pieces import PieceStore
from service.usecases.resumable_upload import sweep_uploads
from tests import files, web
from tests.server import ClientFor, Server, new_client, running
from tests.service.tus_client import (
    PIECE,
    PLY,
    SHA256,
    TUS,
    begin,
    checksum,
    create,
    metadata,
    new_map,
    offset,
    offset_when_free,
    piece,
    problem,
    scans,
    slow_piece,
    stored,
    wait_until_stored,
)


@pytest.fixture(scope="module")
def map_id(admin: httpx.Client) -> str:
    return new_map(admin, "shared")


@pytest.fixture(scope="module")
def tablet(client_for: ClientFor) -> httpx.Client:
    return client_for("tablet")


def test_options_need_no_key(server: Server) -> None:
    answer = web.options(f"{server.url}/v1/tus")
    assert answer.status_code == 204
    told = {name: answer.headers[name] for name in answer.headers if name.startswith("tus-")}
    assert told == {
        "tus-resumable": "1.0.0",
        "tus-version": "1.0.0",
        "tus-extension": "creation,creation-with-upload,expiration,termination,checksum",
        "tus-max-size": str(server.settings.max_upload_bytes),
        "tus-checksum-algorithm": "sha1,sha256",
    }


def test_pieces_become_a_scan(server: Server, tablet: httpx.Client, map_id: str) -> None:
    pose = json.dumps({"rough_pose": {"x_m": 1, "y_m": 2, "yaw_rad": 0.5}})
    made = create(tablet, map_id, options=pose)
    assert made.status_code == 201
    assert made.headers["upload-expires"].endswith("GMT")
    location = made.headers["location"]
    assert location.startswith("/v1/tus/"), "it holds under whatever name the service is reached"
    assert offset(tablet, location) == 0
    at = 0
    for size in (1, 70_000, 900_000, 10**9):
        answer = piece(tablet, location, at, PLY[at : at + size])
        assert answer.status_code == 204, answer.text
        assert answer.headers["connection"] == "close"
        at = int(answer.headers["upload-offset"])
    assert at == len(PLY)
    scan = tablet.get(answer.headers["groundplan-result"]).json()
    assert (scan["sha256"], scan["file_name"], scan["map_id"]) == (SHA256, "room.ply", map_id)
    assert scan["rough_pose"] == {"x_m": 1.0, "y_m": 2.0, "z_m": 0.0, "yaw_rad": 0.5}
    assert answer.headers["groundplan-job"] == f"/v1/jobs/{scan['job']['id']}"
    assert server.kernel.blobs.path(SHA256).read_bytes() == PLY
    assert not stored(server, location).exists()
    head = tablet.head(location, headers=TUS)
    assert head.headers["groundplan-result"] == answer.headers["groundplan-result"]
    assert (head.headers["upload-offset"], head.headers["upload-length"]) == (str(at), str(at))
    assert head.headers["cache-control"] == "no-store"
    again = piece(tablet, location, at, b"")
    assert again.headers["groundplan-result"] == answer.headers["groundplan-result"]


def test_pieces_become_a_drawing(tablet: httpx.Client, map_id: str) -> None:
    png = files.png()
    location = begin(
        tablet, map_id, size=len(png), kind="drawing", filename="office.png",
        options='{"scale": {"metres_per_unit": 0.02}, "page": 1}',
    )  # fmt: skip
    answer = piece(tablet, location, 0, png)
    drawing = tablet.get(answer.headers["groundplan-result"]).json()
    assert drawing["options"] == {"page": 1, "scale": {"metres_per_unit": 0.02}}
    assert drawing["job"]["kind"] == "read-drawing"


def test_a_post_may_stand_in_for_patch_and_delete(tablet: httpx.Client, map_id: str) -> None:
    location = begin(tablet, map_id)
    told = PIECE | {"Upload-Offset": "0", "X-HTTP-Method-Override": "PATCH"}
    assert tablet.post(location, headers=told, content=PLY[:100]).headers["upload-offset"] == "100"
    assert tablet.post(location, headers=TUS | {"X-HTTP-Method-Override": "DELETE"}).status_code == 204
    assert tablet.head(location, headers=TUS).status_code == 404


def test_wrong_headers_are_refused(tablet: httpx.Client, map_id: str) -> None:
    location = begin(tablet, map_id)
    old = tablet.patch(
        location, headers=PIECE | {"Tus-Resumable": "0.2.2", "Upload-Offset": "0"}, content=b"x"
    )
    assert problem(old, 412, "tus-version-unsupported")["supported"] == ["1.0.0"]
    assert old.headers["tus-version"] == "1.0.0"
    problem(
        tablet.patch(location, headers=TUS | {"Upload-Offset": "0"}, content=b"x"), 415, "unsupported-media"
    )
    problem(tablet.patch(location, headers=PIECE, content=b"x"), 422, "invalid-request")
    problem(piece(tablet, location, 5, b"x"), 409, "upload-offset-mismatch")
    problem(piece(tablet, location, 0, b"x" * (len(PLY) + 1)), 413, "upload-too-large")
    for wrong in ("-1", "1e3", "", "٣"):
        told = TUS | {
            "Upload-Length": wrong.encode(),
            "Upload-Metadata": metadata(map_id=map_id, kind="scan"),
        }
        problem(tablet.post("/v1/tus", headers=told), 422, "invalid-request")
    problem(create(tablet, map_id, kind="photo"), 422, "invalid-request")
    problem(create(tablet, map_id, options='{"colour": 1}'), 422, "invalid-request")
    problem(create(tablet, map_id, options="{"), 422, "invalid-request")
    problem(create(tablet, "map_none"), 404, "map-not-found")
    problem(create(tablet, map_id, size=0), 422, "file-empty")
    problem(create(tablet, map_id, size=10**15), 413, "upload-too-large")
    bad = TUS | {"Upload-Length": "1", "Upload-Metadata": "map_id !!!"}
    problem(tablet.post("/v1/tus", headers=bad), 422, "invalid-request")
    assert offset(tablet, location) == 0


def test_a_checksum_decides_whether_a_piece_counts(server: Server, tablet: httpx.Client, map_id: str) -> None:
    location = begin(tablet, map_id)
    first, second = PLY[:300_000], PLY[300_000:]
    problem(
        piece(
            tablet, location, 0, first[:-1] + bytes([first[-1] ^ 1]), **{"Upload-Checksum": checksum(first)}
        ),
        460,
        "checksum-mismatch",
    )
    assert offset(tablet, location) == 0
    assert stored(server, location).stat().st_size == 0
    assert piece(tablet, location, 0, first, **{"Upload-Checksum": checksum(first)}).status_code == 204
    for wrong in ("md5 " + "A" * 24, "sha1 AAAA", "sha1", "sha256 !!"):
        problem(
            piece(tablet, location, len(first), second, **{"Upload-Checksum": wrong}),
            400,
            "checksum-unsupported",
        )
    assert offset(tablet, location) == len(first)
    done = piece(tablet, location, len(first), second, **{"Upload-Checksum": checksum(second, "sha256")})
    assert tablet.get(done.headers["groundplan-result"]).json()["sha256"] == SHA256
    assert list(stored(server, location).parent.glob(f"{stored(server, location).name}*")) == []


def test_creating_twice_with_one_key_is_one_upload(tablet: httpx.Client, map_id: str) -> None:
    key = {"Idempotency-Key": "tus-1"}
    first, again = create(tablet, map_id, headers=key), create(tablet, map_id, headers=key)
    assert first.headers["location"] == again.headers["location"]
    problem(create(tablet, map_id, size=5, headers=key), 422, "idempotency-key-reused")


def test_only_its_creator_and_an_admin_see_an_upload(
    tablet: httpx.Client, admin: httpx.Client, client_for: ClientFor, map_id: str
) -> None:
    location = begin(tablet, map_id)
    other, robot = client_for("tablet"), client_for("robot")
    assert other.head(location, headers=TUS).status_code == 404
    problem(piece(other, location, 0, b"x"), 404, "upload-not-found")
    problem(other.delete(location, headers=TUS), 404, "upload-not-found")
    problem(create(robot, map_id), 403, "forbidden")
    assert offset(admin, location) == 0
    problem(
        web.patch(tablet.base_url.join(location), headers=PIECE | {"Upload-Offset": "0"}),
        401,
        "unauthenticated",
    )


def test_an_upload_that_is_given_up_is_gone(server: Server, tablet: httpx.Client, map_id: str) -> None:
    location = begin(tablet, map_id)
    piece(tablet, location, 0, PLY[:1000])
    assert stored(server, location).stat().st_size == 1000
    assert tablet.delete(location, headers=TUS).status_code == 204
    assert not stored(server, location).exists()
    problem(piece(tablet, location, 1000, PLY[1000:]), 404, "upload-not-found")
    problem(tablet.delete(location, headers=TUS), 404, "upload-not-found")


def test_a_file_of_a_wrong_kind_is_refused_by_its_first_bytes(tablet: httpx.Client, map_id: str) -> None:
    content = b"%PDF-1.7\n" + bytes(200_000)
    location = begin(tablet, map_id, size=len(content))
    problem(piece(tablet, location, 0, content[:100_000]), 415, "unsupported-media")
    problem(piece(tablet, location, 100_000, content[100_000:]), 415, "unsupported-media")
    assert offset(tablet, location) == 100_000


def test_a_truncated_file_is_refused_when_it_is_complete(tablet: httpx.Client, map_id: str) -> None:
    content = PLY[:150_000]
    location = begin(tablet, map_id, size=len(content))
    problem(piece(tablet, location, 0, content), 422, "file-truncated")
    head = tablet.head(location, headers=TUS)
    assert (head.headers["upload-offset"], "groundplan-result" in head.headers) == (str(len(content)), False)
    problem(piece(tablet, location, len(content), b""), 422, "file-truncated")


def test_two_writers_at_once_are_one_too_many(server: Server, tablet: httpx.Client, map_id: str) -> None:
    location = begin(tablet, map_id)
    with slow_piece(server, tablet.headers["Authorization"], location, 0, PLY[: 3 << 19]):
        wait_until_stored(stored(server, location), 1 << 20)
        busy = piece(tablet, location, 0, PLY)
        problem(busy, 423, "upload-busy")
        assert busy.headers["retry-after"] == "1"
        head = tablet.head(location, headers=TUS)
        assert (head.status_code, head.headers["retry-after"]) == (423, "1")
        problem(tablet.delete(location, headers=TUS), 423, "upload-busy")
    at = offset_when_free(tablet, location)
    assert 1 << 20 <= at <= 3 << 19
    done = piece(tablet, location, at, PLY[at:])
    assert tablet.get(done.headers["groundplan-result"]).json()["sha256"] == SHA256


def test_a_connection_that_breaks_keeps_what_came(server: Server, tablet: httpx.Client, map_id: str) -> None:
    location = begin(tablet, map_id)
    with slow_piece(server, tablet.headers["Authorization"], location, 0, PLY[:200_000]):
        time.sleep(0.3)
    wait_until_stored(stored(server, location), 200_000)
    assert offset_when_free(tablet, location) == 200_000


def test_many_finishers_make_one_scan(server: Server, tablet: httpx.Client, admin: httpx.Client) -> None:
    map_id = new_map(admin, "finishers")
    location = begin(tablet, map_id)
    piece(tablet, location, 0, PLY[:-1])
    with stored(server, location).open("ab") as file:  # as if the service had died after the last byte
        file.write(PLY[-1:])
    barrier, results = threading.Barrier(6), []

    def finish() -> None:
        client = server.client(tablet.headers["Authorization"].removeprefix("Bearer "))
        barrier.wait()
        for _ in range(50):
            answer = client.head(location, headers=TUS)
            if "groundplan-result" in answer.headers:
                results.append(answer.headers["groundplan-result"])
                return
            time.sleep(0.05)

    threads = [threading.Thread(target=finish) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == 6
    assert [f"/v1/scans/{row['id']}" for row in scans(tablet, map_id)] == sorted(set(results))


def test_an_upload_expires(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "data", upload_expiry_s=1.0)
    with running(settings) as server:
        client = server.client(server.admin_key)
        tablet = new_client(server, "tablet")
        map_id = new_map(client, "expiring")
        location = begin(tablet, map_id)
        piece(tablet, location, 0, PLY[:1000])
        time.sleep(1.1)
        assert tablet.head(location, headers=TUS).status_code == 410
        problem(piece(tablet, location, 1000, PLY[1000:]), 410, "upload-expired")
        problem(tablet.delete(location, headers=TUS), 410, "upload-expired")
        assert stored(server, location).exists()


def test_expired_and_finished_uploads_are_swept(server: Server, tablet: httpx.Client, map_id: str) -> None:
    live, finished = begin(tablet, map_id), begin(tablet, map_id)
    piece(tablet, finished, 0, PLY)
    pieces = PieceStore(server.settings.data_dir)
    names = {name: stored(server, where) for name, where in (("live", live), ("finished", finished))}
    orphan = names["live"].parent / "upl_orphan"
    for path in (names["finished"], orphan):
        path.write_bytes(b"left behind")
    sweep_uploads(server.kernel, pieces)
    assert all(path.exists() for path in (*names.values(), orphan))  # young files stay
    for path in (*names.values(), orphan):
        _age(path)
    assert set(sweep_uploads(server.kernel, pieces)) >= {names["finished"].name, orphan.name}
    assert names["live"].exists()
    assert not names["finished"].exists()
    assert not orphan.exists()


def _age(path: Path) -> None:
    os.utime(path, (0, 0))
