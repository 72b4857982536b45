"""Downloads behind the front of docker-compose.yml: the same answers as the bare service's, from nginx."""

from __future__ import annotations

import base64
import hashlib
import random
import secrets
import socket
import ssl
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest

from service.settings import Settings
from tests import files, web
from tests.foreign.tus_js import TusJs
from tests.front import PREFIX, Front, fronted
from tests.server import Server, running, start
from tests.service.asking import a_map, ok, refused
from tests.service.by_hand import ByHand

BIG = random.Random(20).randbytes(3_000_000)
CODED = b"stands in for the coded form of the same file"
_BY_NGINX_ALONE = {
    "server",
    "date",
    "connection",
    "last-modified",
    "content-length",
    "x-request-id",
    "ratelimit",
}


@pytest.fixture(scope="module")
def fronts(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Server, Front]]:
    """Give a bare service, and the front of another process of it."""
    folder = tmp_path_factory.mktemp("front")
    with running(Settings(data_dir=folder / "data")) as bare:
        behind = start(bare.settings, admin_key=bare.admin_key, **PREFIX)
        try:
            with fronted(behind, folder / "nginx") as front:
                yield bare, front
        finally:
            behind.close()


@pytest.fixture(scope="module")
def clients(fronts: tuple[Server, Front]) -> Iterator[tuple[httpx.Client, httpx.Client, str]]:
    """Give a client of the bare service, one of the front, and the path of a revision's files."""
    bare, front = fronts
    direct = bare.client(bare.admin_key)
    map_id, by_hand = a_map(direct), ByHand(bare.kernel)
    body = {"drawing_id": by_hand.drawing(map_id)}
    made = ok(direct.post(f"/v1/maps/{map_id}/revisions", json=body), 202)
    by_hand.build(made["job"]["id"], cloud=BIG, more={"point-cloud.pcd.zst": CODED})
    with front.client(bare.admin_key) as client:
        yield direct, client, f"/v1/maps/{map_id}/revisions/1/artifacts"


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"Accept-Encoding": "zstd"},
        {"Range": "bytes=5-1000"},
        {"Range": "bytes=2999990-", "If-Range": f'"{hashlib.sha256(BIG).hexdigest()}"'},
        {"Range": "bytes=5-1000", "If-Range": '"another"'},
        {"If-None-Match": f'"{hashlib.sha256(BIG).hexdigest()}"'},
        {"If-None-Match": '"another"'},
        {"If-Modified-Since": "Fri, 01 Jan 2100 00:00:00 GMT"},
        {"If-Match": f'"{hashlib.sha256(BIG).hexdigest()}"'},
        {"Range": "bytes=9000000-"},
    ],
    ids=str,
)
def test_the_front_answers_as_the_service_does(
    clients: tuple[httpx.Client, httpx.Client, str], headers: dict[str, str]
) -> None:
    direct, front, files = clients
    for method in ("GET", "HEAD"):
        request = {"method": method, "headers": {"Accept-Encoding": "identity", **headers}}
        told, wanted = (_raw(client, f"{files}/point-cloud.pcd", request) for client in (front, direct))
        assert told == wanted


def test_another_file_than_is_wanted_is_refused(clients: tuple[httpx.Client, httpx.Client, str]) -> None:
    for client in clients[:2]:
        answer = client.get(f"{clients[2]}/point-cloud.pcd", headers={"If-Match": '"another"'})
        assert answer.status_code == 412
        assert answer.json()["type"].endswith("/problems/file-is-another")


def _raw(client: httpx.Client, path: str, request: dict[str, object]) -> tuple[int, dict[str, str], bytes]:
    """Return status, headers and the very bytes of an answer."""
    with client.stream(str(request["method"]), path, headers=request["headers"]) as answer:  # type: ignore[arg-type]
        body = b"".join(answer.iter_raw())
        kept = {k: v for k, v in answer.headers.items() if k not in _BY_NGINX_ALONE}
        if request["method"] == "GET" and answer.status_code in {200, 206}:
            assert int(answer.headers["content-length"]) == len(body)
        if answer.status_code == 416:
            body = b""  # its problem document names the address that was asked
        return answer.status_code, kept, body


def test_nginx_sends_the_file_and_only_to_who_may_have_it(
    fronts: tuple[Server, Front], clients: tuple[httpx.Client, httpx.Client, str]
) -> None:
    bare, front = fronts
    _, client, files = clients
    answer = client.get(f"{files}/point-cloud.pcd")
    assert answer.content == BIG
    assert answer.headers["server"] == "nginx"
    assert "last-modified" in answer.headers, "nginx knows the file: it came from the folder"
    sha256 = hashlib.sha256(BIG).hexdigest()
    assert client.get(f"/_blobs/{sha256[:2]}/{sha256}").status_code == 404, "the folder is no door"
    with front.client("gp_wrong") as stranger:
        assert stranger.get(f"{files}/point-cloud.pcd").status_code == 401
    assert refused(bare.client("gp_wrong").get(f"{files}/point-cloud.pcd"), 401, "unauthenticated")


def test_large_uploads_and_event_streams_pass(
    clients: tuple[httpx.Client, httpx.Client, str], tmp_path: Path
) -> None:
    _, client, files = clients
    map_id = files.split("/")[3]
    plan = tmp_path / "plan.png"
    plan.write_bytes(b"\x89PNG\r\n\x1a\n" + secrets.token_bytes(8_000_000))
    with plan.open("rb") as file:
        answer = client.post(f"/v1/maps/{map_id}/drawings", files={"file": ("plan.png", file, "image/png")})
    assert answer.status_code in {202, 422}, answer.text  # 422: such a picture is refused, by the service
    assert answer.headers["content-type"] in {"application/json", "application/problem+json"}
    with client.stream("GET", "/v1/events") as events:
        assert next(events.iter_raw()) == b"retry: 1000\n\n"


def test_pieces_of_uploads_have_a_connection_each(clients: tuple[httpx.Client, httpx.Client, str]) -> None:
    _, client, _ = clients
    answer = client.options("/v1/tus")
    assert answer.headers["tus-resumable"] == "1.0.0"
    assert answer.headers["connection"] == "close"
    assert client.get("/v1/maps").headers.get("connection") != "close"


def test_long_metadata_of_an_upload_passes_both_ways(clients: tuple[httpx.Client, httpx.Client, str]) -> None:
    _, front, files = clients
    said = {"map_id": files.split("/")[3], "kind": "scan", "note": "n" * 5900}
    metadata = ",".join(f"{key} {base64.b64encode(text.encode()).decode()}" for key, text in said.items())
    assert 7900 < len(metadata) < 8100
    told = {"Tus-Resumable": "1.0.0", "Upload-Length": "9", "Upload-Metadata": metadata}
    made = front.post("/v1/tus", headers=told)
    assert made.status_code == 201, made.text
    head = front.head(httpx.URL(made.headers["location"]).path, headers=told)
    assert (head.status_code, head.headers["upload-metadata"]) == (200, metadata)


def test_nginx_says_to_browsers_on_its_own_answers_what_the_service_says(
    fronts: tuple[Server, Front], tmp_path: Path
) -> None:
    _, front = fronts
    with front.client("none") as client:
        own = client.get("/_blobs/none")
        passed = client.get("/v1/maps")
    for answer in (own, passed):
        assert answer.headers.get_list("x-content-type-options") == ["nosniff"]
        assert len(answer.headers.get_list("content-security-policy")) == 1
    assert (own.status_code, own.headers["server"]) == (404, "nginx")
    with running(Settings(data_dir=tmp_path / "data")) as gone:
        pass
    with fronted(gone, tmp_path / "nginx", is_up=False) as alone, alone.client("none") as client:
        answer = client.get("/v1/maps")
    assert answer.status_code == 502
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["content-security-policy"] == "default-src 'none'; frame-ancestors 'none'"


@pytest.mark.parametrize(
    "path",
    [
        "/metrics",
        "/metrics/",
        "/metrics?x",
        "//metrics",
        "/./metrics",
        "/v1/../metrics",
        "/%6detrics",
        "/metric%73",
        "/%2e/metrics",
        "/v1/maps/..%2f..%2fmetrics",
    ],
)
def test_the_front_gives_no_metrics(fronts: tuple[Server, Front], path: str) -> None:
    bare, front = fronts
    assert "groundplan_jobs" in web.get(f"{bare.url}/metrics").text
    where = urlsplit(front.url)
    trusted = ssl.create_default_context(cafile=str(front.certificate))
    for method in ("GET", "HEAD", "POST"):
        with trusted.wrap_socket(
            socket.create_connection((where.hostname, where.port)), server_hostname="localhost"
        ) as connection:
            lines = (f"{method} {path} HTTP/1.1", "Host: x", "Content-Length: 0", "Connection: close", "", "")
            connection.sendall("\r\n".join(lines).encode())
            answer = b"".join(iter(lambda: connection.recv(65536), b""))
        assert answer.startswith(b"HTTP/1.1 404"), answer
        assert b"groundplan_" not in answer


@pytest.mark.parametrize("options", [{}, {"uploadDataDuringCreation": True}, {"chunkSize": 400_000}], ids=str)
def test_a_client_of_others_uploads_through_the_front(
    tus_js: TusJs,
    fronts: tuple[Server, Front],
    clients: tuple[httpx.Client, httpx.Client, str],
    tmp_path: Path,
    options: dict[str, Any],
) -> None:
    _, front, place = clients
    content = files.ply(files.room(80_000, seed=len(str(options))))
    (tmp_path / "r.ply").write_bytes(content)
    metadata = {"map_id": place.split("/")[3], "kind": "scan", "name": "r.ply", "type": ""}
    key = f"Bearer {fronts[0].admin_key}"
    told = {"metadata": metadata, **options}
    nginx = fronts[1]
    story = tus_js(nginx.url, key, tmp_path / "r.ply", trusting=nginx.certificate, options=told)
    assert story["ended"] == "done", story
    scan = ok(front.get(story["Groundplan-Result"]))
    assert scan["sha256"] == hashlib.sha256(content).hexdigest()
