"""Tus 1.0 as others write it: metadata of their own, extensions not offered, bytes with the creation."""

from __future__ import annotations

import base64
import hashlib
from typing import Any

import httpx
import pytest

from service.api.schemas.tus import EXTENSIONS
from tests import files, web
from tests.server import ClientFor, Server

PLY = files.ply(files.room(20_000))
SHA256 = hashlib.sha256(PLY).hexdigest()
TUS = {"Tus-Resumable": "1.0.0"}
PIECE = {"Content-Type": "application/offset+octet-stream"}


@pytest.fixture(scope="module")
def map_id(admin: httpx.Client) -> str:
    made = admin.post("/v1/maps", json={"site": "tus", "name": "protocol"})
    assert made.status_code == 201, made.text
    return str(made.json()["id"])


@pytest.fixture(scope="module")
def tablet(client_for: ClientFor) -> httpx.Client:
    return client_for("tablet")


def encoded(content: str | bytes) -> str:
    return base64.b64encode(content if isinstance(content, bytes) else content.encode()).decode()


def said(map_id: str, *more: str, kind: str = "scan") -> str:
    return ",".join([f"map_id {encoded(map_id)}", f"kind {encoded(kind)}", *more])


def create(
    client: httpx.Client, metadata: str, *, content: bytes = b"", size: int = len(PLY), **headers: str
) -> httpx.Response:
    told = TUS | {"Upload-Length": str(size), "Upload-Metadata": metadata} | headers
    raw = {name: value.encode("latin-1") for name, value in told.items()}
    return client.post("/v1/tus", headers=raw, content=content)


def problem(answer: httpx.Response, status: int, slug: str) -> dict[str, Any]:
    assert answer.status_code == status, answer.text
    assert answer.headers["tus-resumable"] == "1.0.0"
    body: dict[str, Any] = answer.json()
    assert body["type"].endswith(f"/problems/{slug}"), body
    assert body["status"] == status
    return body


def uploads(server: Server) -> set[str]:
    return {path.name for path in (server.settings.data_dir / "uploads").iterdir()}


# name, type and relativePath are Uppy's, in its order; a value may be empty or not be there
OF_OTHERS = {
    "uppy": (
        f"relativePath {encoded('null')},name {encoded('hall 1.ply')},type {encoded('')},"
        f"filetype {encoded('')},filename {encoded('hall 1.ply')}"
    ),
    "no value": "relativePath",
    "an empty value": "relativePath ,owner",
    "blanks": f"  owner   {encoded('me')}  , x-y_z.1  {encoded('1')}",
    "binary": f"thumbnail {encoded(bytes(range(256)))}",
    "ours in other letters": f"Map_Id {encoded('another')},KIND {encoded('drawing')}",
    "upper case and signs": f"X!#$%&'*+.^`|~ {encoded('?')}",
    "many": ",".join(f"k{i} {encoded(str(i))}" for i in range(100)),
    "a trailing comma": "relativePath,",
    "text in Japanese": f"note {encoded('工場')}",
}


@pytest.mark.parametrize("metadata", OF_OTHERS.values(), ids=list(OF_OTHERS))
def test_metadata_of_others_is_passed_over_and_told_again(
    tablet: httpx.Client, map_id: str, metadata: str
) -> None:
    whole = said(map_id, metadata)
    made = create(tablet, whole)
    assert made.status_code == 201, made.text
    head = tablet.head(made.headers["location"], headers=TUS)
    assert head.status_code == 200
    assert head.headers["upload-metadata"] == whole.strip()
    assert head.headers["upload-offset"] == "0"


@pytest.mark.parametrize(
    ("metadata", "name"),
    [
        (f"name {encoded('a.ply')}", "a.ply"),
        (f"name {encoded('a.ply')},filename {encoded('b.ply')}", "b.ply"),
        (f"filename,name {encoded('a.ply')}", "a.ply"),
        (f"filename {encoded('../../etc/b.ply')}", "b.ply"),
        ("filename", "unnamed"),
    ],
)
def test_a_file_is_called_as_the_sender_calls_it(
    tablet: httpx.Client, map_id: str, metadata: str, name: str
) -> None:
    done = create(tablet, said(map_id, metadata), content=PLY, **PIECE)
    assert done.status_code == 201, done.text
    assert tablet.get(done.headers["groundplan-result"]).json()["file_name"] == name


@pytest.mark.parametrize(
    ("metadata", "word"),
    [
        ("a !!!", "base64"),
        ("a QQ", "base64"),
        ("a QQ==,a QQ==", "twice"),
        ("a,a", "twice"),
        ("x\x85 YQ==", "ASCII"),
        ("x\x7f YQ==", "ASCII"),
        ("filename /w==", "UTF-8"),
        ("options /w==", "UTF-8"),
        ("a " + encoded(bytes(8000)), "characters"),
    ],
)
def test_metadata_that_breaks_the_rules_is_refused(
    server: Server, tablet: httpx.Client, map_id: str, metadata: str, word: str
) -> None:
    before = uploads(server)
    told = problem(create(tablet, said(map_id, metadata)), 422, "invalid-request")
    assert word in told["detail"]
    assert uploads(server) == before


def test_metadata_of_ours_is_still_required(tablet: httpx.Client, map_id: str) -> None:
    for metadata in (f"map_id {encoded(map_id)}", f"kind {encoded('scan')}", "map_id,kind", ""):
        problem(create(tablet, metadata), 422, "invalid-request")


@pytest.mark.parametrize(
    ("header", "value", "extension"),
    [
        ("Upload-Concat", "partial", "concatenation"),
        ("Upload-Concat", "final;/v1/tus/a /v1/tus/b", "concatenation"),
        ("Upload-Concat", "", "concatenation"),
        ("Upload-Defer-Length", "1", "creation-defer-length"),
        ("Upload-Defer-Length", "0", "creation-defer-length"),
        ("Trailer", "X-A, upload-checksum", "checksum-trailer"),
    ],
)
def test_what_belongs_to_an_extension_not_offered_is_refused(
    server: Server, tablet: httpx.Client, map_id: str, header: str, value: str, extension: str
) -> None:
    offered = web.options(f"{server.url}/v1/tus").headers["tus-extension"].split(",")
    assert extension not in offered
    before = uploads(server)
    told = problem(create(tablet, said(map_id), **{header: value}), 400, "tus-extension-not-offered")
    assert (told["extension"], told["offered"]) == (extension, list(EXTENSIONS))
    without_length = TUS | {"Upload-Metadata": said(map_id), header: value}
    problem(tablet.post("/v1/tus", headers=without_length), 400, "tus-extension-not-offered")
    assert uploads(server) == before
    location = create(tablet, said(map_id)).headers["location"]
    piece = TUS | PIECE | {"Upload-Offset": "0", header: value}
    problem(tablet.patch(location, headers=piece, content=PLY), 400, "tus-extension-not-offered")
    assert tablet.head(location, headers=TUS).headers["upload-offset"] == "0"


def test_a_trailer_of_another_kind_is_no_extension(tablet: httpx.Client, map_id: str) -> None:
    assert create(tablet, said(map_id), Trailer="Server-Timing").status_code == 201


def test_a_file_may_come_whole_with_its_creation(server: Server, tablet: httpx.Client, map_id: str) -> None:
    done = create(tablet, said(map_id, f"filename {encoded('r.ply')}"), content=PLY, **PIECE)
    assert done.status_code == 201, done.text
    assert done.headers["upload-offset"] == str(len(PLY))
    assert done.headers["upload-expires"].endswith("GMT")
    scan = tablet.get(done.headers["groundplan-result"]).json()
    assert (scan["sha256"], scan["file_name"]) == (SHA256, "r.ply")
    assert done.headers["groundplan-job"] == f"/v1/jobs/{scan['job']['id']}"
    assert server.kernel.blobs.path(SHA256).read_bytes() == PLY
    head = tablet.head(done.headers["location"], headers=TUS)
    assert head.headers["groundplan-result"] == done.headers["groundplan-result"]


@pytest.mark.parametrize("checked", [False, True])
def test_a_part_may_come_with_the_creation(tablet: httpx.Client, map_id: str, *, checked: bool) -> None:
    part = PLY[:70_001]
    digest = {"Upload-Checksum": f"sha256 {encoded(hashlib.sha256(part).digest())}"} if checked else {}
    made = create(tablet, said(map_id), content=part, **PIECE, **digest)
    assert (made.status_code, made.headers["upload-offset"]) == (201, "70001")
    assert "groundplan-result" not in made.headers
    rest = TUS | PIECE | {"Upload-Offset": "70001"}
    done = tablet.patch(made.headers["location"], headers=rest, content=PLY[70_001:])
    assert tablet.get(done.headers["groundplan-result"]).json()["sha256"] == SHA256


def test_a_creation_with_no_bytes_begins_at_zero(tablet: httpx.Client, map_id: str) -> None:
    made = create(tablet, said(map_id), **PIECE)
    assert (made.status_code, made.headers["upload-offset"]) == (201, "0")
    assert "upload-offset" not in create(tablet, said(map_id)).headers


def test_a_creation_sent_twice_with_its_bytes_is_one_upload(tablet: httpx.Client, map_id: str) -> None:
    once = {"Idempotency-Key": "with-bytes"}
    first = create(tablet, said(map_id), content=PLY[:1000], **PIECE, **once)
    again = create(tablet, said(map_id), content=PLY[:1000], **PIECE, **once)
    assert (again.status_code, again.headers["upload-offset"]) == (201, "1000")
    assert again.headers["location"] == first.headers["location"]
    rest = TUS | PIECE | {"Upload-Offset": "1000"}
    done = tablet.patch(first.headers["location"], headers=rest, content=PLY[1000:])
    assert tablet.get(done.headers["groundplan-result"]).json()["sha256"] == SHA256
    last = create(tablet, said(map_id), content=PLY[:1000], **PIECE, **once)
    assert last.headers["groundplan-result"] == done.headers["groundplan-result"]


def test_bytes_that_are_refused_are_refused_with_the_creation(
    server: Server, tablet: httpx.Client, map_id: str
) -> None:
    before = uploads(server)
    problem(create(tablet, said(map_id), content=PLY, size=10, **PIECE), 413, "upload-too-large")
    problem(create(tablet, said(map_id), content=b"{}"), 415, "unsupported-media")
    as_text = {"Content-Type": "text/plain"}
    problem(create(tablet, said(map_id), content=PLY, **as_text), 415, "unsupported-media")
    as_md5 = {"Upload-Checksum": "md5 " + encoded(bytes(16))}
    problem(create(tablet, said(map_id), content=PLY, **PIECE, **as_md5), 400, "checksum-unsupported")
    problem(create(tablet, said("map_none"), content=PLY, **PIECE), 404, "map-not-found")
    assert uploads(server) == before


def test_what_a_refused_body_leaves_behind_is_told(tablet: httpx.Client, map_id: str) -> None:
    wrong = {"Upload-Checksum": f"sha1 {encoded(bytes(20))}"}
    damaged = create(tablet, said(map_id), content=PLY, **PIECE, **wrong)
    assert problem(damaged, 460, "checksum-mismatch")["location"] == damaged.headers["location"]
    place = damaged.headers["location"]
    assert tablet.head(place, headers=TUS).headers["upload-offset"] == "0"
    done = tablet.patch(place, headers=TUS | PIECE | {"Upload-Offset": "0"}, content=PLY)
    assert tablet.get(done.headers["groundplan-result"]).json()["sha256"] == SHA256
    other = b"%PDF-1.7\n" + bytes(100_000)
    wrong_kind = create(tablet, said(map_id), content=other, size=len(other), **PIECE)
    problem(wrong_kind, 415, "unsupported-media")
    assert tablet.delete(wrong_kind.headers["location"], headers=TUS).status_code == 204


def test_the_content_type_of_a_piece_may_be_written_freely(tablet: httpx.Client, map_id: str) -> None:
    for content_type in ("Application/Offset+Octet-Stream", "application/offset+octet-stream; v=1"):
        made = create(tablet, said(map_id), content=PLY[:10], **{"Content-Type": content_type})
        assert (made.status_code, made.headers["upload-offset"]) == (201, "10")
    for content_type in ("application/octet-stream", "application/offset", ""):
        piece = TUS | {"Content-Type": content_type, "Upload-Offset": "10"}
        answer = tablet.patch(made.headers["location"], headers=piece, content=b"x")
        problem(answer, 415, "unsupported-media")
