"""Downloads: tags from the content, conditions, ranges, and memory that does not grow."""

from __future__ import annotations

import base64
import hashlib
from dataclasses import dataclass

import httpx
import numpy as np
import pytest

from service.api.conditions import match, none_match, one_range, range_applies
from tests.server import ClientFor, Server
from tests.service.asking import a_map, a_ready_revision, ok, refused
from tests.service.by_hand import CLOUD, ByHand

MIB = 1024 * 1024
SIZE = len(CLOUD)
SHA = hashlib.sha256(CLOUD).hexdigest()
ETAG = f'"{SHA}"'


@dataclass(frozen=True)
class File:
    """Hold a downloadable file and who may have it."""

    robot: httpx.Client
    path: str

    def get(self, **headers: str) -> httpx.Response:
        """Return the answer to a GET; underscores in header names are hyphens."""
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        return self.robot.get(self.path, headers={"Accept-Encoding": "identity", **named})


@pytest.fixture(scope="module")
def file(admin: httpx.Client, by_hand: ByHand, client_for: ClientFor) -> File:
    map_id = a_map(admin)
    made = ok(admin.post(f"/v1/maps/{map_id}/revisions", json={"drawing_id": by_hand.drawing(map_id)}), 202)
    by_hand.build(made["job"]["id"])
    return File(client_for("robot", [map_id]), f"/v1/maps/{map_id}/revisions/1/artifacts/point-cloud.pcd")


def test_a_whole_file_comes_with_its_hash(file: File) -> None:
    answer = file.get()
    assert (answer.status_code, answer.content) == (200, CLOUD)
    assert answer.headers["etag"] == ETAG
    assert answer.headers["content-length"] == str(SIZE)
    assert answer.headers["cache-control"] == "private, max-age=31536000, immutable"
    assert answer.headers["accept-ranges"] == "bytes"
    digest = base64.b64encode(hashlib.sha256(CLOUD).digest()).decode()
    assert answer.headers["repr-digest"] == f"sha-256=:{digest}:"


def test_head_says_the_same_without_the_bytes(file: File) -> None:
    whole, head = file.get(), file.robot.head(file.path)
    assert (head.status_code, head.content) == (200, b"")
    varying = {"date", "x-request-id", "ratelimit"}
    assert {k: v for k, v in head.headers.items() if k not in varying} == {
        k: v for k, v in whole.headers.items() if k not in varying
    }


@pytest.mark.parametrize("header", [ETAG, f"W/{ETAG}", f'"a", W/"b" , {ETAG}', "*"])
def test_who_has_it_is_told_so(file: File, header: str) -> None:
    answer = file.get(If_None_Match=header)
    assert (answer.status_code, answer.content) == (304, b"")
    assert answer.headers["etag"] == ETAG
    head = file.robot.head(file.path, headers={"If-None-Match": header})
    assert head.status_code == 304


@pytest.mark.parametrize("header", [ETAG, f'"x", {ETAG}', "*"])
def test_who_wants_this_file_alone_gets_it(file: File, header: str) -> None:
    assert file.get(If_Match=header).content == CLOUD
    assert file.get(If_Match=header, Range="bytes=5-9").content == CLOUD[5:10]
    assert file.get(If_Match=header, If_None_Match=ETAG).status_code == 304
    coded = file.get(If_Match=header, Accept_Encoding="zstd, gzip")
    assert coded.status_code == 200
    assert file.get(If_Match=coded.headers["etag"], Accept_Encoding="zstd, gzip").status_code == 200


@pytest.mark.parametrize("header", ['"x"', f"W/{ETAG}", SHA, "", f'"x{SHA}"', f'"x" {ETAG}'])
@pytest.mark.parametrize(
    "more", [{}, {"Range": "bytes=0-0"}, {"Range": "bytes=9999999-"}, {"If_None_Match": "*"}]
)
def test_who_wants_another_file_is_told_so(file: File, header: str, more: dict[str, str]) -> None:
    problem = refused(file.get(If_Match=header, **more), 412, "file-is-another")
    assert problem["etag"] == ETAG
    named = {name.replace("_", "-"): value for name, value in more.items()}
    head = file.robot.head(file.path, headers={"If-Match": header, **named})
    assert (head.status_code, head.content) == (412, b"")


def test_conditions_on_several_lines_are_one_list(file: File) -> None:
    for name, status in (("If-Match", 200), ("If-None-Match", 304)):
        lines = [(name, '"x"'), (name, ETAG), ("Accept-Encoding", "identity")]
        assert file.robot.get(file.path, headers=lines).status_code == status


def test_every_download_knows_if_match(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id = a_map(admin)
    n = a_ready_revision(admin, by_hand, map_id)
    place = f"/v1/maps/{map_id}/revisions/{n}"
    signed = ok(admin.get(f"{place}/link", params={"path": "point-cloud.pcd"}))["url"]
    paths = [f"{place}/artifacts/{row['path']}" for row in ok(admin.get(f"{place}/artifacts"))["items"]]
    assert len(paths) > 1
    for path in [*paths, signed]:
        refused(admin.get(path, headers={"If-Match": '"x"'}), 412, "file-is-another")
        etag = admin.get(path, headers={"Accept-Encoding": "identity"}).headers["etag"]
        assert admin.get(path, headers={"If-Match": etag}).status_code == 200


@pytest.mark.parametrize("header", ['"x"', SHA, "", '"', f"x{ETAG}", f'"x" {ETAG}'])
def test_who_has_something_else_gets_it(file: File, header: str) -> None:
    assert file.get(If_None_Match=header).content == CLOUD


@pytest.mark.parametrize(
    ("asked", "begin", "end"),
    [
        ("bytes=0-0", 0, 1),
        ("bytes=0-99", 0, 100),
        ("bytes=100-", 100, SIZE),
        ("bytes=-7", SIZE - 7, SIZE),
        (f"bytes=-{SIZE * 2}", 0, SIZE),
        (f"bytes={SIZE - 1}-{SIZE * 9}", SIZE - 1, SIZE),
        ("Bytes = 5 - 6", 5, 7),
    ],
)
def test_a_range_is_cut_out(file: File, asked: str, begin: int, end: int) -> None:
    for extra in ({}, {"If_Range": ETAG}):
        answer = file.get(Range=asked, **extra)
        assert (answer.status_code, answer.content) == (206, CLOUD[begin:end])
        assert answer.headers["content-range"] == f"bytes {begin}-{end - 1}/{SIZE}"
        assert answer.headers["content-length"] == str(end - begin)
        assert answer.headers["etag"] == ETAG


@pytest.mark.parametrize("asked", [f"bytes={SIZE}-", f"bytes={SIZE * 3}-{SIZE * 4}", "bytes=-0"])
def test_a_range_outside_is_refused(file: File, asked: str) -> None:
    answer = file.get(Range=asked)
    assert answer.status_code == 416
    assert answer.headers["content-range"] == f"bytes */{SIZE}"
    assert answer.headers["content-type"] == "application/problem+json"
    assert file.get(Range=asked, If_None_Match=ETAG).status_code == 304


@pytest.mark.parametrize(
    "asked",
    ["bytes=0-1,5-6", "lines=0-1", "bytes=", "bytes=-", "bytes=9-3", "bytes=a-b", f"bytes={'9' * 40}-"],
)
def test_a_range_that_cannot_be_read_is_ignored(file: File, asked: str) -> None:
    answer = file.get(Range=asked)
    assert (answer.status_code, answer.content) == (200, CLOUD)


@pytest.mark.parametrize("header", ['"x"', f"W/{ETAG}", "Mon, 01 Jan 2024 00:00:00 GMT"])
def test_a_range_of_another_file_gives_the_whole(file: File, header: str) -> None:
    answer = file.get(Range="bytes=0-9", If_Range=header)
    assert (answer.status_code, answer.content) == (200, CLOUD)


def test_files_that_do_not_exist(file: File) -> None:
    folder = file.path.rpartition("/")[0]
    for name in ("nothing.pcd", "..%2f..%2fservice.log", "point-cloud.pcd/", "%2e%2e/x"):
        assert file.robot.get(f"{folder}/{name}").status_code == 404, name
    refused(file.robot.get(f"{folder}/nothing.pcd"), 404, "artifact-not-found")


def test_memory_does_not_grow_with_the_file(server: Server, admin: httpx.Client, by_hand: ByHand) -> None:
    map_id = a_map(admin)
    block = np.random.default_rng(5).bytes(MIB)
    with server.kernel.blobs.stage(max_bytes=1 << 30) as staged:
        for _ in range(200):
            staged.write(block)
        staged.keep()
    content = block * 200
    made = ok(admin.post(f"/v1/maps/{map_id}/revisions", json={"drawing_id": by_hand.drawing(map_id)}), 202)
    by_hand.build(made["job"]["id"], cloud=content)
    before, most, seen = server.rss_bytes, 0, hashlib.sha256()
    with admin.stream("GET", f"/v1/maps/{map_id}/revisions/1/artifacts/point-cloud.pcd") as answer:
        for chunk in answer.iter_raw(MIB):
            seen.update(chunk)
            most = max(most, server.rss_bytes)
    assert seen.hexdigest() == hashlib.sha256(content).hexdigest()
    assert most - before < 20 * MIB


def test_the_conditions_by_themselves() -> None:
    assert one_range(None, 10) is None
    with pytest.raises(ValueError, match="of 0"):
        one_range("bytes=0-", 0)
    assert range_applies(None, "a")
    assert not range_applies('W/"a"', "a")
    assert match('"b", "a"', "a")
    assert not match('W/"a"', "a")
    assert not match("*", None)
    assert none_match(None, "a")
    assert not none_match('W/"a"', "a")
