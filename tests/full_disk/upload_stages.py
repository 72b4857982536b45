"""The disk is full at every stage of every upload: each is told, nothing is lost, reading goes on.

Run by `test_full_disk.py` in a mount namespace of its own.
"""

from __future__ import annotations

import base64
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import psutil
import pytest
from sqlalchemy import select

from service.db.models import Blob, Drawing
from service.settings import Settings
from tests import files, web
from tests.full_disk.small_disk import RESERVE_BYTES, SmallDisk, let_go, mounted, order_halt, wait_halted
from tests.server import Server, start
from tests.service.asking import a_map, a_ready_revision, ok, refused
from tests.service.by_hand import CLOUD, ByHand

TUS = {"Tus-Resumable": "1.0.0"}
FORM = ("blob.before-fsync", "blob.before-rename", "blob.after-rename", "receive-drawing.before-commit")
PIECES = (
    "create-upload.before-commit",
    "upload.before-fsync",
    "upload.after-fsync",
    "blob.before-fsync",
    "blob.before-rename",
    "blob.after-rename",
    "finish-upload.before-commit",
    "finish-upload.after-commit",
)
STAGES = [*(("form", point) for point in FORM), *(("pieces", point) for point in PIECES)]
SOME = [("form", "receive-drawing.before-commit"), ("pieces", "create-upload.before-commit"), STAGES[-2]]


class Story:
    """A service on the small disk with a map and a ready revision."""

    def __init__(self, disk: SmallDisk) -> None:
        self.disk = disk
        self.settings = Settings(data_dir=disk.folder / "data")
        told = {"GROUNDPLAN_CRASH_AT": "@crash-at", "GROUNDPLAN_RESERVE_BYTES": str(RESERVE_BYTES)}
        self.server: Server = start(self.settings, **told)
        self.client = self.server.client(self.server.admin_key)
        by_hand = ByHand(self.server.kernel)
        self.map_id = a_map(self.client)
        self.n = a_ready_revision(self.client, by_hand, self.map_id)

    def send(self, upload: str, content: bytes) -> httpx.Response:
        """Return the answer to an upload in one of the two ways; the first that is refused ends it."""
        if upload == "form":
            where = f"/v1/maps/{self.map_id}/drawings"
            return self.client.post(where, files={"file": ("hall.png", content)})
        told = {"map_id": self.map_id, "kind": "drawing", "filename": "hall.png"}
        metadata = ",".join(f"{name} {base64.b64encode(v.encode()).decode()}" for name, v in told.items())
        headers = TUS | {"Upload-Length": str(len(content)), "Upload-Metadata": metadata}
        begun = self.client.post("/v1/tus", headers=headers)
        if begun.status_code != 201:
            return begun
        self.upload = "/v1/tus/" + begun.headers["location"].rpartition("/")[2]
        return self.send_rest(content)

    def send_rest(self, content: bytes) -> httpx.Response:
        """Return the answer to what is still to come of an upload in pieces."""
        at = int(self.client.head(self.upload, headers=TUS).headers["upload-offset"])
        headers = TUS | {"Upload-Offset": str(at), "Content-Type": "application/offset+octet-stream"}
        return self.client.patch(self.upload, headers=headers, content=content[at:])

    def drawings(self) -> list[str]:
        """Return the SHA-256 of each drawing's file."""
        with self.server.kernel.db.reading() as session:
            return list(session.scalars(select(Drawing.blob_sha256)))

    def orphans(self) -> set[str]:
        """Return blobs that no row names, and files that are half there."""
        root = self.settings.data_dir
        with self.server.kernel.db.reading() as session:
            rows = set(session.scalars(select(Blob.sha256)))
        blobs = {path.name for path in (root / "blobs").glob("??/*")} - rows
        return blobs | {path.name for path in (root / "blobs" / ".tmp").iterdir()}

    def assert_still_read(self) -> None:
        """Assert that what is stored is shown and given, and that the service tells of its disk."""
        assert ok(web.get(f"{self.server.url}/readyz"))["checks"]["storage"].startswith("storage-full")
        assert 'groundplan_storage_full{holds="data"} 1.0' in metrics_of(self.server)
        for where in ("/v1/maps", "/v1/jobs", "/v1/stats", "/v1/audit", f"/v1/maps/{self.map_id}/drawings"):
            ok(self.client.get(where))
        cloud = self.client.get(f"/v1/maps/{self.map_id}/revisions/{self.n}/artifacts/point-cloud.pcd")
        assert (cloud.status_code, cloud.content) == (200, CLOUD)
        assert self.client.get("/").status_code == 200


def metrics_of(server: Server) -> str:
    """Return the service's metrics."""
    return web.get(f"{server.url}/metrics").text


@pytest.fixture(scope="module")
def story(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Story]:
    """Give the installation."""
    with mounted(tmp_path_factory.mktemp("full") / "disk") as disk:
        made = Story(disk)
        try:
            yield made
        finally:
            disk.make_room()
            made.server.close()


def _cases() -> list[object]:
    stages = STAGES if os.environ.get("GROUNDPLAN_TEST_STAGES") == "all" else SOME
    return [pytest.param(*stage, id="-".join(stage)) for stage in stages]


def _sent_meanwhile(
    send: Callable[[], httpx.Response], at_halt: Callable[[], None], story: Story
) -> httpx.Response:
    answers: list[httpx.Response] = []
    thread = threading.Thread(target=lambda: answers.append(send()))
    thread.start()
    halted: psutil.Process = wait_halted(
        story.server.process.pid, story.settings.data_dir, is_over=lambda: not thread.is_alive()
    )
    at_halt()
    let_go(halted)
    thread.join(120)
    return answers[0]


@pytest.mark.parametrize(("upload", "point"), _cases())
def test_an_upload_is_told_that_the_disk_is_full(story: Story, upload: str, point: str) -> None:
    content = files.png() + f"{upload} {point}".encode()
    before = story.drawings()
    order_halt(story.settings.data_dir, point)
    answer = _sent_meanwhile(lambda: story.send(upload, content), story.disk.fill, story)
    assert story.disk.free_bytes < RESERVE_BYTES
    if answer.status_code >= 300:
        refused(answer, 507, "storage-full")
        assert answer.headers["retry-after"] == "60"
        assert story.drawings() == before
    story.assert_still_read()
    assert story.orphans() == set()
    refused(story.send("form", content), 507, "storage-full")
    story.disk.make_room()
    if answer.status_code >= 300:
        begun = upload == "pieces" and point != "create-upload.before-commit"
        again = story.send_rest(content) if begun else story.send(upload, content)
        assert again.status_code in {202, 204}, again.text
    print(f"{upload:7} {point:34} {answer.status_code} -> one drawing")  # noqa: T201
    assert len(story.drawings()) == len(before) + 1
    assert story.orphans() == set()


def test_pieces_stop_at_the_reserve_and_go_on(story: Story) -> None:
    content = files.png() + bytes(8 << 20)
    told = {"map_id": story.map_id, "kind": "drawing", "filename": "hall.png"}
    metadata = ",".join(f"{name} {base64.b64encode(v.encode()).decode()}" for name, v in told.items())
    begin = TUS | {"Upload-Length": str(len(content)), "Upload-Metadata": metadata}
    story.disk.fill(leave_bytes=RESERVE_BYTES + (4 << 20))
    refused(story.client.post("/v1/tus", headers=begin), 507, "storage-full")
    story.disk.make_room()
    begun = story.client.post("/v1/tus", headers=begin)
    story.upload = "/v1/tus/" + begun.headers["location"].rpartition("/")[2]
    story.disk.fill(leave_bytes=RESERVE_BYTES + (4 << 20))
    refused(story.send_rest(content), 507, "storage-full")
    headers = TUS | {"Upload-Offset": "0", "Content-Type": "application/offset+octet-stream"}
    chunks = iter([content[at : at + (1 << 18)] for at in range(0, len(content), 1 << 18)])
    refused(story.client.patch(story.upload, headers=headers, content=chunks), 507, "storage-full")
    kept = int(story.client.head(story.upload, headers=TUS).headers["upload-offset"])
    assert 0 < kept <= 4 << 20, "what came before the reserve stays"
    assert story.disk.free_bytes >= RESERVE_BYTES
    story.disk.make_room()
    before = story.drawings()
    assert story.send_rest(content).status_code == 204
    assert len(story.drawings()) == len(before) + 1


def test_blobs_on_a_full_disk_of_their_own_are_refused(tmp_path: Path) -> None:
    data_dir = tmp_path / "data"
    data_dir.mkdir()
    with mounted(data_dir / "blobs") as disk:
        told = {"GROUNDPLAN_RESERVE_BYTES": str(RESERVE_BYTES)}
        server = start(Settings(data_dir=data_dir), **told)
        client = server.client(server.admin_key)
        where = f"/v1/maps/{a_map(client)}/drawings"
        disk.fill(leave_bytes=RESERVE_BYTES // 2)
        problem = refused(client.post(where, files={"file": ("a.png", files.png())}), 507, "storage-full")
        assert "(blobs)" in problem["detail"]
        disk.make_room()
        disk.fill(leave_bytes=2 * RESERVE_BYTES)
        too_long = client.post(where, files={"file": ("a.png", files.png() + bytes(2 * RESERVE_BYTES))})
        assert "(blobs)" in refused(too_long, 507, "storage-full")["detail"]
        assert client.post(where, files={"file": ("a.png", files.png())}).status_code == 202
        server.close()
