"""Uploads in pieces go on where the disk is, whenever the service is killed."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from service.settings import Settings
from tests.patience import PATIENCE_S
from tests.server import Server, start
from tests.service.tus_client import (
    PLY,
    SHA256,
    TUS,
    begin,
    checksum,
    create,
    new_map,
    offset,
    piece,
    scans,
    slow_piece,
    stored,
    wait_until_stored,
)


@pytest.fixture
def killable() -> Iterator[list[Server]]:
    """Give a list of servers that are closed at the end."""
    servers: list[Server] = []
    yield servers
    for server in servers:
        server.close()


def test_a_service_killed_within_a_piece_goes_on_where_the_disk_is(
    tmp_path: Path, killable: list[Server]
) -> None:
    settings = Settings(data_dir=tmp_path / "data")
    killable.append(start(settings))
    key = killable[0].admin_key
    map_id = new_map(killable[0].client(key), "killed")
    at, path = 0, Path()
    location = begin(killable[0].client(key), map_id)
    for _ in range(3):
        server = killable[-1]
        location = f"{server.url}{httpx.URL(location).path}"
        path = stored(server, location)
        with slow_piece(server, f"Bearer {key}", location, at, PLY[at : at + 700_000 + (1 << 20)]):
            wait_until_stored(path, at + 500_000)
            server.stop(signal.SIGKILL)
        killable.append(start(settings, admin_key=key))
        location = f"{killable[-1].url}{httpx.URL(location).path}"
        size = path.stat().st_size
        assert offset(killable[-1].client(key), location) == size
        assert path.read_bytes() == PLY[:size]
        at = size
        if size > len(PLY) - (2 << 20):
            break
    client = killable[-1].client(key)
    done = piece(client, location, at, PLY[at:])
    scan = client.get(done.headers["groundplan-result"]).json()
    assert scan["sha256"] == SHA256
    assert killable[-1].kernel.blobs.path(SHA256).read_bytes() == PLY
    assert len(scans(client, map_id)) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("point", "verified"),
    [
        ("create-upload.before-commit", False),
        ("create-upload.after-commit", False),
        ("upload.before-fsync", False),
        ("upload.after-fsync", False),
        ("upload.before-fsync", True),
        ("upload.after-fsync", True),
        ("blob.before-fsync", False),
        ("blob.before-rename", False),
        ("blob.after-rename", False),
        ("finish-upload.before-commit", False),
        ("finish-upload.after-commit", False),
    ],
)
def test_a_kill_at_any_point_of_an_upload_ends_in_one_scan(
    tmp_path: Path, killable: list[Server], point: str, *, verified: bool
) -> None:
    settings = Settings(data_dir=tmp_path / "data")
    killable.append(start(settings, GROUNDPLAN_CRASH_AT=point))
    key = killable[0].admin_key
    map_id = new_map(killable[0].client(key), "points")
    result = _upload(killable, settings, map_id, verified=verified)
    client = killable[-1].client(key)
    assert len(killable) == 2, "the crash point was not reached"
    assert killable[0].process.returncode == -signal.SIGKILL
    assert [f"/v1/scans/{row['id']}" for row in scans(client, map_id)] == [result]
    assert client.get(result).json()["sha256"] == SHA256
    assert killable[-1].kernel.blobs.path(SHA256).read_bytes() == PLY


def _upload(servers: list[Server], settings: Settings, map_id: str, *, verified: bool) -> str:
    """Return what an upload of two pieces becomes, by a client that goes on after every lost connection."""
    key, path = servers[0].admin_key, ""
    while True:
        client = servers[-1].client(key)
        try:
            if not path:
                answer = create(client, map_id, headers={"Idempotency-Key": "one"})
                path = httpx.URL(answer.headers["location"]).path
            head = client.head(path, headers=TUS)
            if "groundplan-result" in head.headers:
                return str(head.headers["groundplan-result"])
            at = int(head.headers["upload-offset"])
            content = PLY[at : at + len(PLY) // 2 + 1]
            extra = {"Upload-Checksum": checksum(content)} if verified else {}
            assert piece(client, path, at, content, **extra).status_code == 204
        except httpx.TransportError:
            servers[-1].process.wait(timeout=PATIENCE_S)
            servers.append(start(settings, admin_key=key))
