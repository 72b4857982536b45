"""Uploads by the tus clients of others, as they come from npm and PyPI: every file arrives once and whole."""

from __future__ import annotations

import hashlib
import io
import json
import sys
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import pytest
from tusclient import client as tuspy
from tusclient.exceptions import TusCommunicationError
from tusclient.storage.filestorage import FileStorage

from tests import files
from tests.bad_network import bad_network
from tests.foreign.tus_js import TusJs
from tests.server import ClientFor, Server

POINTS = 20_000
CUT_EVERY = 90_000  # bytes: more than a piece of each client, much less than the file


@dataclass
class Desk:
    """What each upload works with: the service, who sends, and a scan that nobody has sent before."""

    server: Server
    tablet: httpx.Client
    map_id: str
    file: Path
    content: bytes = field(repr=False)

    @property
    def key(self) -> str:
        """Return the header with the sender's key."""
        return self.tablet.headers["authorization"]

    @property
    def metadata(self) -> dict[str, str]:
        """Return what the service needs to know of the upload."""
        return {"map_id": self.map_id, "kind": "scan", "filename": self.file.name}

    def scans(self) -> list[dict[str, Any]]:
        """Return the scans of the map whose content is the file's."""
        rows = self.tablet.get(f"/v1/maps/{self.map_id}/scans").raise_for_status().json()["items"]
        digest = hashlib.sha256(self.content).hexdigest()
        return [row for row in rows if row["sha256"] == digest]

    def pending(self) -> set[str]:
        """Return the names of what has begun and not ended."""
        return {path.name for path in (self.server.settings.data_dir / "uploads").iterdir()}


@pytest.fixture(scope="module")
def map_id(admin: httpx.Client) -> str:
    """Give a map."""
    made = admin.post("/v1/maps", json={"site": "tus", "name": "foreign"}).raise_for_status()
    return str(made.json()["id"])


@pytest.fixture
def desk(
    server: Server, client_for: ClientFor, map_id: str, tmp_path: Path, request: pytest.FixtureRequest
) -> Iterator[Desk]:
    """Give a desk with a file of its own; whatever happens, each file becomes one scan at most."""
    seed = int.from_bytes(hashlib.sha256(request.node.nodeid.encode()).digest()[:4], "big")
    content = files.ply(files.room(POINTS, seed=seed))
    path = tmp_path / "hall 1 工場.ply"
    path.write_bytes(content)
    made = Desk(server, client_for("tablet"), map_id, path, content)
    yield made
    assert len(made.scans()) <= 1


def by_tus_js(tus_js: TusJs, desk: Desk, *, url: str | None = None, **order: Any) -> dict[str, Any]:
    """Return the story of an upload by tus-js-client."""
    options = {"metadata": desk.metadata, **order.pop("options", {})}
    return tus_js(url or desk.server.url, desk.key, desk.file, options=options, **order)


# what Uppy hands to tus-js-client for a file: its own metadata, in its order
UPPYS = {"relativePath": "null", "name": "hall 1.ply", "type": "", "filetype": "", "filename": "hall 1.ply"}

WAYS: dict[str, dict[str, Any]] = {
    "whole": {},
    "in pieces": {"options": {"chunkSize": 70_001}},
    "with its creation": {"options": {"uploadDataDuringCreation": True}},
    "in pieces with its creation": {"options": {"uploadDataDuringCreation": True, "chunkSize": 100_000}},
    "where PATCH cannot pass": {"options": {"overridePatchMethod": True, "chunkSize": 100_000}},
    "as a stream": {"stream": True, "options": {"chunkSize": 90_000, "uploadSize": None}},
    "with ids of requests": {"options": {"addRequestId": True}},
    "stopped and resumed": {"stopAfter": 140_000, "thenResume": True, "options": {"chunkSize": 70_000}},
}


@pytest.mark.parametrize("way", list(WAYS))
def test_tus_js_client_uploads(way: str, tus_js: TusJs, desk: Desk, tmp_path: Path) -> None:
    order = json.loads(json.dumps(WAYS[way]))
    if order.get("stream"):
        order["options"]["uploadSize"] = len(desk.content)
    if order.get("thenResume"):
        order["storage"] = str(tmp_path / "urls.json")
    story = by_tus_js(tus_js, desk, **order)
    assert story["ended"] == "done", story
    assert all(200 <= status < 300 for _, status in story["requests"]), story
    (scan,) = desk.scans()
    assert scan["file_name"] == desk.file.name
    assert story["Groundplan-Result"] == f"/v1/scans/{scan['id']}"
    assert story["Groundplan-Job"] == f"/v1/jobs/{scan['job']['id']}"
    if order.get("thenResume"):
        assert [method for method, _ in story["requests"]].count("POST") == 1
        assert story["requests"].count(["PATCH", 204]) == -(-len(desk.content) // 70_000)


def test_uppys_metadata_is_taken_and_told_again(tus_js: TusJs, desk: Desk) -> None:
    told = UPPYS | {"map_id": desk.map_id, "kind": "scan"}
    story = by_tus_js(tus_js, desk, options={"metadata": told, "chunkSize": 200_000})
    assert (story["ended"], desk.scans()[0]["file_name"]) == ("done", "hall 1.ply")
    head = desk.tablet.head(story["url"], headers={"Tus-Resumable": "1.0.0"})
    assert [pair.partition(" ")[0] for pair in head.headers["upload-metadata"].split(",")] == list(told)


def test_a_bad_network_costs_tus_js_client_no_file(tus_js: TusJs, desk: Desk) -> None:
    with bad_network(desk.server.url, rate=400_000.0, cut_every=CUT_EVERY) as network:
        story = by_tus_js(tus_js, desk, url=network.url, options={"chunkSize": 50_000}, retryDelays=[50] * 60)
        assert network.cuts >= len(desk.content) // CUT_EVERY > 1
    assert story["ended"] == "done", story
    assert len(desk.scans()) == 1


REFUSED: dict[str, tuple[dict[str, Any], str, int]] = {
    "in parallel parts": ({"parallelUploads": 3}, "tus-extension-not-offered", 400),
    "of unknown length": (
        {"uploadLengthDeferred": True, "chunkSize": 50_000},
        "tus-extension-not-offered",
        400,
    ),
    "by a draft of another protocol": ({"protocol": "ietf-draft-05"}, "tus-version-unsupported", 412),
    "without a map": ({"metadata": {"kind": "scan"}}, "invalid-request", 422),
    "with a wrong key": ({"headers": {"Authorization": "Bearer nobody"}}, "unauthenticated", 401),
}


@pytest.mark.parametrize("what", list(REFUSED))
def test_what_is_not_offered_is_told_to_tus_js_client(what: str, tus_js: TusJs, desk: Desk) -> None:
    options, slug, status = REFUSED[what]
    before = desk.pending()
    story = by_tus_js(tus_js, desk, options=options, stream="uploadLengthDeferred" in options)
    assert story["ended"] == "refused", story
    assert {seen for _, seen in story["requests"]} == {status}
    assert story["problem"]["type"].endswith(f"/problems/{slug}"), story
    assert desk.pending() == before
    assert desk.scans() == []


def test_tus_js_client_gives_an_upload_up(tus_js: TusJs, desk: Desk) -> None:
    before = desk.pending()
    story = by_tus_js(tus_js, desk, stopAfter=70_000, terminate=True, options={"chunkSize": 70_000})
    assert story["ended"] == "stopped", story
    assert story["requests"][-1] == ["DELETE", 204]
    assert desk.pending() == before
    assert desk.tablet.head(story["url"], headers={"Tus-Resumable": "1.0.0"}).status_code == 404


class _Kept(io.BytesIO):
    """A file that stays open: tuspy closes what it is given before it sends it, when it keeps addresses."""

    def close(self) -> None:
        """Do nothing."""


def uploader(desk: Desk, *, url: str | None = None, **options: Any) -> Any:
    """Return an uploader of tuspy."""
    sender = tuspy.TusClient(f"{url or desk.server.url}/v1/tus", headers={"Authorization": desk.key})
    return sender.uploader(file_stream=_Kept(desk.content), metadata=desk.metadata, **options)


@pytest.mark.parametrize("checked", [False, True])
@pytest.mark.parametrize("chunk_size", [70_001, sys.maxsize])
def test_tuspy_uploads(desk: Desk, chunk_size: int, *, checked: bool) -> None:
    uploader(desk, upload_checksum=checked, chunk_size=chunk_size).upload()
    (scan,) = desk.scans()
    assert scan["file_name"] == desk.file.name


def test_tuspy_goes_on_where_it_stopped(desk: Desk, tmp_path: Path) -> None:
    with closing(FileStorage(str(tmp_path / "urls"))) as storage:  # type: ignore[no-untyped-call]  # tuspy's
        first = uploader(desk, store_url=True, url_storage=storage, chunk_size=70_000)
        first.upload(stop_at=140_000)
        second = uploader(desk, store_url=True, url_storage=storage, chunk_size=70_000)
        assert (second.url, second.offset) == (first.url, 140_000)
        second.upload()
    assert len(desk.scans()) == 1


def test_a_bad_network_costs_tuspy_no_file(desk: Desk) -> None:
    with bad_network(desk.server.url, rate=400_000.0, cut_every=CUT_EVERY) as network:
        uploader(desk, url=network.url, chunk_size=30_000, retries=60, retry_delay=0.05).upload()
        assert network.cuts >= len(desk.content) // CUT_EVERY > 1
    assert len(desk.scans()) == 1


def test_a_refusal_reaches_who_uses_tuspy(desk: Desk) -> None:
    before = desk.pending()
    sender = tuspy.TusClient(f"{desk.server.url}/v1/tus", headers={"Authorization": desk.key})
    with pytest.raises(TusCommunicationError) as refusal:
        sender.uploader(file_stream=_Kept(desk.content), metadata={"kind": "scan"}).upload()
    assert refusal.value.status_code == 422
    assert json.loads(refusal.value.response_content)["type"].endswith("/problems/invalid-request")
    assert desk.pending() == before


def test_tuspy_reads_what_the_server_offers(desk: Desk) -> None:
    upload = uploader(desk)
    upload.set_url(upload.create_url())
    assert upload.get_offset() == 0
    desk.tablet.delete(upload.url, headers={"Tus-Resumable": "1.0.0"}).raise_for_status()
