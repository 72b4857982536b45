"""Below the reserve nothing new is taken, and all that is there is still given."""

from __future__ import annotations

import base64
import errno
import os
import shutil
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

from service.app import open_kernel
from service.domain.errors import StorageFull
from service.domain.reserve import RESERVE_BYTES, reserve_of
from service.settings import Settings
from service.storage.local import LocalBlobStore
from service.storage.pieces import PieceStore
from service.storage.room import Room, Space, tells_full_disk
from service.usecases.bytes_first import bytes_first
from tests import files, web
from tests.architecture.sources import ROOT
from tests.patience import PATIENCE_S
from tests.server import Server, start
from tests.service.asking import a_map, a_placement, a_ready_revision, ok, refused
from tests.service.by_hand import ByHand

EVERYTHING = str(1 << 60)
"""A reserve that no disk has: every disk is full."""

PNG = files.png()
PIECE = {"Content-Type": "application/offset+octet-stream", "Tus-Resumable": "1.0.0"}


class Installation:
    """A service with a map, a drawing, a scan and two revisions, which is started again as full or roomy."""

    def __init__(self, data_dir: Path) -> None:
        self.settings = Settings(data_dir=data_dir)
        self.server = start(self.settings)
        self.key = self.server.admin_key
        by_hand, self.map_id = ByHand(self.server.kernel), a_map(self.client)
        self.drawing_id, self.scan_id = by_hand.drawing(self.map_id), by_hand.scan(self.map_id)
        self.placement_id = a_placement_of(self.client, by_hand, self.map_id)
        a_ready_revision(self.client, by_hand, self.map_id)
        self.failed_id = self._failed_job(by_hand)
        self.upload = self._begin_upload()

    @property
    def client(self) -> httpx.Client:
        """Return a client with the admin key."""
        return self.server.client(self.key)

    def restart(self, **more: str) -> Server:
        """Start the service anew with other settings."""
        self.server.close()
        self.server = start(self.settings, admin_key=self.key, **more)
        return self.server

    def files(self) -> set[Path]:
        """Return every file that uploads and blobs have."""
        root = self.settings.data_dir
        return {path for name in ("blobs", "uploads") for path in (root / name).rglob("*")}

    def _failed_job(self, by_hand: ByHand) -> str:
        job_id = ok(self.client.get(f"/v1/drawings/{by_hand.drawing(self.map_id, read=False)}"))["job"]["id"]
        by_hand.fail(job_id, problem=StorageFull("x").problem())
        return str(job_id)

    def _begin_upload(self) -> str:
        begun = self.client.post("/v1/tus", headers=creation(self.map_id))
        assert begun.status_code == 201, begun.text
        return "/v1/tus/" + begun.headers["location"].rpartition("/")[2]


def a_placement_of(client: httpx.Client, by_hand: ByHand, map_id: str) -> str:
    """Return a placement on a ready revision of the map."""
    a_ready_revision(client, by_hand, map_id)
    return a_placement(client, by_hand, map_id)


def creation(map_id: str, *, size_bytes: int = len(PNG)) -> dict[str, str]:
    """Return the headers that begin an upload in pieces."""
    told = {"map_id": map_id, "kind": "drawing", "filename": "hall.png"}
    metadata = ",".join(f"{name} {base64.b64encode(v.encode()).decode()}" for name, v in told.items())
    return {"Tus-Resumable": "1.0.0", "Upload-Length": str(size_bytes), "Upload-Metadata": metadata}


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Installation]:
    """Give an installation whose disk has less than the reserve."""
    made = Installation(tmp_path_factory.mktemp("full"))
    made.restart(GROUNDPLAN_RESERVE_BYTES=EVERYTHING)
    yield made
    made.server.close()


@pytest.mark.parametrize(
    ("total", "kept"),
    [(64 << 20, (64 << 20) // 20), (20 << 30, 1 << 30), ((20 << 30) - 20, (1 << 30) - 1), (1 << 50, 1 << 30)],
)
def test_the_reserve_is_the_lesser_of_two(total: int, kept: int) -> None:
    assert reserve_of(total) == kept
    assert reserve_of(total) <= RESERVE_BYTES


@pytest.mark.parametrize(("free", "is_full"), [(99, True), (100, False), (101, False)])
def test_a_disk_is_full_below_its_reserve(free: int, is_full: bool) -> None:  # noqa: FBT001 - a case
    assert Space("data", free, 100).is_full is is_full


def test_room_is_asked_for_what_would_be_taken(tmp_path: Path) -> None:
    usage = os.statvfs(tmp_path)
    free = usage.f_bavail * usage.f_frsize
    room = Room({"data": tmp_path, "blobs": tmp_path}, reserve_bytes=free // 2)
    room.require(free // 4)
    with pytest.raises(StorageFull) as refusal:
        room.require(free)
    assert refusal.value.members["reserve_bytes"] == free // 2
    assert [space.name for space in room.spaces()] == ["data"], "one disk is looked at once"


def test_room_is_asked_for_on_the_disk_where_the_bytes_go(tmp_path: Path) -> None:
    with a_disk_of_its_own() as other:
        free = min(shutil.disk_usage(folder).free for folder in (tmp_path, other))
        here = Room({"data": tmp_path, "uploads": tmp_path, "blobs": other}, reserve_bytes=0)
        for folders, into in (({"blobs"}, other), ({"uploads"}, tmp_path)):
            more = shutil.disk_usage(into).free + (64 << 20)
            with pytest.raises(StorageFull) as refusal:
                here.require(more, into=folders)
            name = "blobs" if into == other else "data"
            assert f"({name})" in refusal.value.detail
        here.require(free // 2, into={"uploads", "blobs"})
        assert [space.name for space in here.spaces()] == ["data", "blobs"]


def test_the_scarcest_disk_is_the_one_with_the_least_above_its_reserve(tmp_path: Path) -> None:
    assert Room({}).scarcest() is None
    with a_disk_of_its_own() as other:
        folders = {"data": tmp_path, "blobs": other}
        free = {name: shutil.disk_usage(folder).free for name, folder in folders.items()}
        found = Room(folders, reserve_bytes=1 << 60).scarcest()
        assert found is not None
        assert (found.name, found.is_full) == (min(free, key=lambda name: free[name]), True)
        told = found.did_not_do(5)
        assert (told.members["free_bytes"], told.members["tries"]) == (found.free_bytes, 5)


def test_every_folder_that_takes_files_is_looked_at(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    told = {"data": tmp_path, "uploads": tmp_path / "uploads", "blobs": tmp_path / "blobs"}
    assert settings.folders() == told | {"database": tmp_path}
    open_kernel(settings).db.close()
    PieceStore(tmp_path)
    assert {path.name for path in tmp_path.iterdir() if path.is_dir()} <= set(settings.folders())


@contextmanager
def a_disk_of_its_own() -> Iterator[Path]:
    """Give a folder on another file system than the temporary files'; skip where there is none."""
    shared = Path("/dev/shm")  # noqa: S108 - a folder of our own in it
    if not shared.is_dir() or shared.stat().st_dev == Path(tempfile.gettempdir()).stat().st_dev:
        pytest.skip("this machine has no second file system to write to")
    with tempfile.TemporaryDirectory(dir=shared) as folder:
        yield Path(folder)


def test_an_error_far_below_tells_of_the_full_disk() -> None:
    damaged = ValueError("the file is damaged")
    assert not tells_full_disk(damaged)
    damaged.__cause__ = OSError(errno.EIO, "Input/output error")
    assert not tells_full_disk(damaged)
    damaged.__cause__.__context__ = OSError(errno.ENOSPC, "No space left on device")
    assert tells_full_disk(damaged)


REQUESTS: dict[str, tuple[str, str, dict[str, Any]]] = {
    "a drawing": ("POST", "/v1/maps/{map_id}/drawings", {"files": {"file": ("a.png", PNG)}}),
    "a scan": ("POST", "/v1/maps/{map_id}/scans", {"files": {"file": ("a.ply", files.ply(files.room()))}}),
    "the beginning of pieces": ("POST", "/v1/tus", {"headers": "creation"}),
    "a piece": ("PATCH", "{upload}", {"headers": PIECE | {"Upload-Offset": "0"}, "content": PNG[:10]}),
    "a revision": ("POST", "/v1/maps/{map_id}/revisions", {"json": {"drawing_id": "{drawing_id}"}}),
    "a placement": ("POST", "/v1/scans/{scan_id}/placements", {"json": {"rough_pose": {"x_m": 1, "y_m": 2}}}),
    "an accepted placement": ("POST", "/v1/placements/{placement_id}/accept", {"json": {"reviewed": True}}),
    "another scale": ("PATCH", "/v1/drawings/{drawing_id}", {"json": {"scale": {"metres_per_unit": 0.03}}}),
    "a rebuild": ("POST", "/v1/maps/{map_id}/revisions/1/rebuild", {}),
    "an export": ("POST", "/v1/maps/{map_id}/revisions/1/exports", {"json": {"format": "laz"}}),
    "a comparison": ("GET", "/v1/maps/{map_id}/revisions/2/compare?with=1", {}),
    "a job tried again": ("POST", "/v1/jobs/{failed_id}/retry", {}),
}


@pytest.mark.parametrize("what", REQUESTS)
def test_nothing_new_is_taken(full: Installation, what: str) -> None:
    method, where, more = REQUESTS[what]
    if more.get("headers") == "creation":
        more = {"headers": creation(full.map_id)}
    if "drawing_id" in more.get("json", {}):
        more = {"json": {"drawing_id": full.drawing_id}}
    before = full.files()
    answer = full.client.request(method, where.format(**vars(full)), **more)
    problem = refused(answer, 507, "storage-full")
    assert problem["reserve_bytes"] == 1 << 60
    assert 0 < problem["free_bytes"] < 1 << 60
    assert answer.headers["retry-after"] == "60"
    assert full.files() == before


def test_every_way_to_a_job_looks_for_room() -> None:
    spared = {
        "receive_drawing.py": "its bytes were asked for room before they came",
        "receive_scan.py": "its bytes were asked for room before they came",
        "dispatch_webhooks.py": "it writes rows alone",
    }
    found = {
        path.name
        for path in (ROOT / "service/usecases").glob("*.py")
        if any(call in path.read_text(encoding="utf-8") for call in (" enqueue(", " retry("))
    }
    looks = {
        path.name
        for path in (ROOT / "service/usecases").glob("*.py")
        if "room.require(" in path.read_text(encoding="utf-8")
    }
    assert found - looks == set(spared)


@pytest.mark.parametrize("kind", ["Content-Length", "chunked"])
def test_no_byte_is_read_first(full: Installation, kind: str) -> None:
    host, port = full.server.url.removeprefix("http://").split(":")
    length = "Content-Length: 5000000" if kind == "Content-Length" else "Transfer-Encoding: chunked"
    head = (
        f"POST /v1/maps/{full.map_id}/drawings HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {full.key}\r\n"
        f"Content-Type: multipart/form-data; boundary=b\r\n{length}\r\nExpect: 100-continue\r\n\r\n"
    )
    with socket.create_connection((host, int(port)), timeout=PATIENCE_S) as sender:
        sender.sendall(head.encode())
        answer = sender.recv(65536)
    assert answer.startswith(b"HTTP/1.1 507 "), answer


def test_the_body_of_readiness_says_so(full: Installation) -> None:
    body = ok(web.get(full.server.url + "/readyz"))
    assert body["checks"]["storage"].startswith("storage-full: ")
    assert (body["checks"]["database"], body["checks"]["schema"]) == ("ok", "ok")


def test_the_metrics_say_so(full: Installation) -> None:
    said = web.get(full.server.url + "/metrics").text
    assert 'groundplan_storage_full{holds="data"} 1.0' in said
    assert f'groundplan_storage_reserve_bytes{{holds="data"}} {float(1 << 60)}' in said
    assert 'groundplan_storage_free_bytes{holds="data"}' in said
    assert ok(full.client.get("/v1/stats"))["is_storage_full"] is True


def test_all_goes_on_when_there_is_room(tmp_path: Path) -> None:
    made = Installation(tmp_path)
    client, headers = made.client, PIECE | {"Upload-Offset": "0"}
    assert client.patch(made.upload, headers=headers, content=PNG[:10]).status_code == 204
    made.restart(GROUNDPLAN_RESERVE_BYTES=EVERYTHING)
    rest = {"headers": PIECE | {"Upload-Offset": "10"}, "content": PNG[10:]}
    refused(made.client.patch(made.upload, **rest), 507, "storage-full")
    assert made.client.head(made.upload, headers=PIECE).headers["upload-offset"] == "10"
    made.restart()
    ended = made.client.patch(made.upload, **rest)
    assert ended.status_code == 204, ended.text
    drawing = ok(made.client.get(ended.headers["groundplan-result"]))
    assert drawing["job"]["state"] == "queued"
    made.server.close()


def test_bytes_without_rows_go_again(tmp_path: Path) -> None:
    made = Installation(tmp_path / "one")
    kernel = made.server.kernel
    store, before = LocalBlobStore(made.settings.data_dir), made.files()

    def keep(content: bytes) -> None:
        with store.stage(max_bytes=100) as staged:
            staged.write(content)
            staged.keep()

    def keep_and_fail(*contents: bytes) -> None:
        with bytes_first(kernel):
            for content in contents:
                keep(content)
            raise StorageFull("The rows found no room.")

    known = b"a drawing of " + made.map_id.encode()
    with pytest.raises(StorageFull):
        keep_and_fail(b"new", b"new too", known)
    assert {path for path in made.files() - before if path.is_file()} == set()
    with pytest.raises(StorageFull):
        keep_and_fail(b"twice", b"twice")
    assert len({path for path in made.files() - before if path.is_file()}) == 1, "another's since"
    made.server.close()
