"""What every answer says to browsers: pages, files, refusals, defects, and what answers no request at all."""

from __future__ import annotations

import socket
import ssl
import subprocess
import sys
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest
from sqlalchemy import text

from service.settings import Settings
from service.web.pages import CONTENT_SECURITY_POLICY, DIST
from tests import web
from tests.front import make_certificate
from tests.patience import PATIENCE_S
from tests.server import Server, environment, running
from tests.service.asking import a_map, a_ready_revision, ok
from tests.service.by_hand import ByHand

ALWAYS = {
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), geolocation=(), microphone=(), payment=(), usb=()",
}
NOTHING_RUNS = "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
PAGES = ["/", "/tablet", "/docs"]
YEAR_S = 31_536_000


def _said(answer: httpx.Response) -> list[tuple[str, str]]:
    """Return what an answer says to browsers; each header has to stand there once."""
    wanted = ALWAYS.keys() | {"content-security-policy", "strict-transport-security"}
    return sorted((k.lower(), v) for k, v in answer.headers.multi_items() if k.lower() in wanted)


def _all(policy: str | None) -> list[tuple[str, str]]:
    return sorted([*ALWAYS.items(), *([("content-security-policy", policy)] if policy else [])])


def test_every_operation_without_a_key(server: Server) -> None:
    paths = ok(web.get(f"{server.url}/openapi.json"))["paths"]
    asked = 0
    for path, operations in paths.items():
        for method in operations:
            answer = web.request(method, server.url + path.replace("{n}", "1"))
            assert _said(answer) == _all(NOTHING_RUNS), f"{method} {path}"
            asked += 1
    assert asked > 80


@pytest.mark.parametrize(
    "path", [*PAGES, *(f"/assets/{f.name}" for f in sorted((DIST / "assets").iterdir()))]
)
def test_pages_and_what_they_load(server: Server, path: str) -> None:
    answer = web.get(server.url + path)
    assert answer.status_code == 200
    assert _said(answer) == _all(CONTENT_SECURITY_POLICY)


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/nowhere", 404),
        ("DELETE", "/healthz", 405),
        ("GET", "/problems/map-not-found", 200),
        ("GET", "/openapi.json", 200),
        ("GET", "/v1/maps/%00", 422),
        ("GET", "/v1/maps?limit=x", 422),
        ("GET", "/assets/none.js", 404),
        ("OPTIONS", "/v1/tus", 204),
    ],
)
def test_refusals_and_bare_answers(admin: httpx.Client, method: str, path: str, status: int) -> None:
    answer = admin.request(method, path)
    assert (answer.status_code, _said(answer)) == (status, _all(NOTHING_RUNS))


def test_an_oversized_body(admin: httpx.Client) -> None:
    large = admin.post("/v1/maps", content=b"x" * 2_000_000, headers={"Content-Type": "application/json"})
    assert (large.status_code, _said(large)) == (413, _all(NOTHING_RUNS))


def test_a_defect(tmp_path: Path) -> None:
    with running(Settings(data_dir=tmp_path)) as broken:
        with broken.kernel.db.engine.begin() as connection:
            connection.execute(text("UPDATE keys SET map_ids = 'no JSON'"))
        answer = broken.client(broken.admin_key).get("/v1/maps")
        assert (answer.status_code, _said(answer)) == (500, _all(NOTHING_RUNS))


def test_downloads_whole_in_part_and_unchanged(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id = a_map(admin)
    a_ready_revision(admin, by_hand, map_id)
    path = f"/v1/maps/{map_id}/revisions/1/artifacts/point-cloud.pcd"
    whole = admin.get(path)
    for status, headers in (
        (200, {}),
        (206, {"Range": "bytes=0-9"}),
        (304, {"If-None-Match": whole.headers["etag"]}),
        (412, {"If-Match": '"another"'}),
        (416, {"Range": "bytes=999999999-"}),
    ):
        answer = admin.get(path, headers=headers)
        assert (answer.status_code, _said(answer)) == (status, _all(NOTHING_RUNS))
    ok(admin.post(f"/v1/maps/{map_id}/revisions/1/publish", json={}))
    poll = f"/v1/maps/{map_id}/published"
    tag = admin.get(poll).headers["etag"]
    for _ in range(3):  # the first is answered by the database, the next from memory
        answer = admin.get(poll, headers={"If-None-Match": tag})
        assert answer.status_code == 304
        assert {k: v for k, v in _said(answer) if k != "content-security-policy"} == ALWAYS


@pytest.mark.parametrize(
    "sent", [b"no request at all\r\n\r\n", b"GET / HTTP/1.1\r\nContent-Length: x\r\n\r\n"]
)
def test_what_is_no_request(server: Server, sent: bytes) -> None:
    where = urlsplit(server.url)
    with socket.create_connection((where.hostname, where.port), timeout=PATIENCE_S) as connection:
        connection.sendall(sent)
        answer = b"".join(iter(lambda: connection.recv(65536), b"")).decode()
    assert answer.startswith("HTTP/1.1 400 ")
    for name, value in ALWAYS.items():
        assert f"\r\n{name}: {value}\r\n".lower() in answer.lower()


@pytest.mark.parametrize(
    ("variables", "told"),
    [
        ({}, None),
        ({"GROUNDPLAN_PUBLIC_URL": "http://plant.example"}, None),
        ({"GROUNDPLAN_PUBLIC_URL": "https://plant.example"}, f"max-age={YEAR_S}"),
        ({"GROUNDPLAN_PUBLIC_URL": "https://plant.example", "GROUNDPLAN_HSTS_S": "60"}, "max-age=60"),
        ({"GROUNDPLAN_PUBLIC_URL": "https://plant.example", "GROUNDPLAN_HSTS_S": "0"}, None),
    ],
)
def test_https_is_asked_for_only_where_it_is_spoken(
    tmp_path: Path, variables: dict[str, str], told: str | None
) -> None:
    with running(Settings(data_dir=tmp_path / "data"), **variables) as server:
        for path in ("/", "/nowhere", "/v1/maps", "/healthz"):
            assert web.get(server.url + path).headers.get("strict-transport-security") == told


def test_a_certificate_of_its_own_asks_for_https(tmp_path: Path) -> None:
    certificate = make_certificate(tmp_path)
    settings = Settings(data_dir=tmp_path / "data")
    with running(settings):
        pass  # the schema is made
    tls = {
        "GROUNDPLAN_TLS_CERT": str(certificate),
        "GROUNDPLAN_TLS_KEY": str(tmp_path / "privkey.pem"),
    }
    command = [sys.executable, "-m", "service", "serve"]
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=environment(settings, **tls),
    ) as process:
        assert process.stdout is not None
        url = process.stdout.readline().split()[-1].replace("127.0.0.1", "localhost")
        trusted = ssl.create_default_context(cafile=str(certificate))
        answer = web.get(f"{url}/healthz", verify=trusted)
        process.terminate()
    assert answer.headers["strict-transport-security"] == f"max-age={YEAR_S}"
