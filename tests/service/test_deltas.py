"""Few bytes for a robot that holds another revision: deltas, tiles, and links that expire."""

from __future__ import annotations

import base64
import hashlib
import random
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest
from sqlalchemy import select

from service.db.models import Job
from tests import web
from tests.server import ClientFor
from tests.service.asking import a_map, ok, refused
from tests.service.by_hand import ByHand
from tests.service.halls import built_revision, hall_files, make_delta

DCZ_MAGIC = b"\x5e\x2a\x4d\x18\x20\x00\x00\x00"


@dataclass(frozen=True)
class Two:
    """Hold a map with the revisions 1 and 2, each on a channel, their files, and a robot's client."""

    map_id: str
    old: dict[str, bytes]
    new: dict[str, bytes]
    robot: httpx.Client

    @property
    def where(self) -> str:
        """Return the path of the revisions."""
        return f"/v1/maps/{self.map_id}/revisions"


@pytest.fixture(scope="module")
def two(
    admin: httpx.Client,
    by_hand: ByHand,
    client_for: ClientFor,
    tmp_path_factory: pytest.TempPathFactory,
) -> Two:
    map_id, folder = a_map(admin), tmp_path_factory.mktemp("halls")
    files = [hall_files(folder / str(x), machine_x=x) for x in (17.0, 19.5)]
    assert [built_revision(admin, by_hand, map_id, each) for each in files] == [1, 2]
    for n in (1, 2):
        ok(admin.post(f"/v1/maps/{map_id}/revisions/{n}/publish", json={"channel": f"channel-{n}"}))
    return Two(map_id, files[0], files[1], client_for("robot", [map_id]))


def sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def test_a_delta_is_made_once_and_the_zstd_program_reads_it(
    two: Two, by_hand: ByHand, admin: httpx.Client, tmp_path: Path
) -> None:
    where = f"{two.where}/2/delta?from=1"
    first, again = (refused(two.robot.get(where), 503, "delta-not-ready") for _ in range(2))
    assert first["job_id"] == again["job_id"]
    assert two.robot.get(where).headers["retry-after"] == "1"
    delta = make_delta(by_hand, first["job_id"], tmp_path)
    answer = two.robot.get(where)
    assert (answer.status_code, answer.content) == (200, delta)
    assert answer.headers["etag"] == f'"{sha256(delta)}"'
    assert answer.headers["content-type"] == "application/zstd"
    assert "content-encoding" not in answer.headers
    assert len(delta) < len(two.new["point-cloud.pcd"]) / 5
    part = two.robot.get(where, headers={"Range": "bytes=5-", "If-Range": answer.headers["etag"]})
    assert (part.status_code, part.content) == (206, delta[5:])
    (tmp_path / "old.pcd").write_bytes(two.old["point-cloud.pcd"])
    (tmp_path / "delta.zst").write_bytes(delta)
    patch = ["zstd", "-dqc", "--long=31", f"--patch-from={tmp_path / 'old.pcd'}", tmp_path / "delta.zst"]
    done = subprocess.run(patch, capture_output=True, check=True)
    assert done.stdout == two.new["point-cloud.pcd"]
    (tmp_path / "old.pcd").write_bytes(two.old["point-cloud.pcd"][:-16] + bytes(16))
    assert subprocess.run(patch, capture_output=True, check=False).returncode != 0
    jobs = ok(admin.get("/v1/jobs", params={"kind": "make-delta", "map": two.map_id}))["items"]
    assert [job["id"] for job in jobs] == [first["job_id"]]


def test_a_client_with_dictionaries_gets_the_same_by_content_coding(
    two: Two, by_hand: ByHand, tmp_path: Path
) -> None:
    where = f"{two.where}/1/artifacts/point-cloud.pcd"
    held = two.new["point-cloud.pcd"]
    offer = base64.b64encode(hashlib.sha256(held).digest()).decode()
    asking = {"Accept-Encoding": "zstd, dcz", "Available-Dictionary": f":{offer}:"}

    def get() -> httpx.Response:
        with two.robot.stream("GET", where, headers=asking) as answer:
            answer._content = b"".join(answer.iter_raw())
        return answer

    plain = get()
    assert plain.headers["content-encoding"] == "zstd", "until the delta is there, the whole file"
    job = refused(two.robot.get(f"{two.where}/1/delta?from=2"), 503, "delta-not-ready")["job_id"]
    delta = make_delta(by_hand, job, tmp_path)
    coded = get()
    head = DCZ_MAGIC + hashlib.sha256(held).digest()
    assert coded.content == head + delta
    assert coded.headers["content-encoding"] == "dcz"
    assert coded.headers["content-length"] == str(len(coded.content))
    assert coded.headers["etag"] == f'"{sha256(coded.content)}"'
    own = base64.b64encode(hashlib.sha256(coded.content).digest()).decode()
    assert coded.headers["repr-digest"] == f"sha-256=:{own}:"
    bare = base64.b64encode(hashlib.sha256(two.old["point-cloud.pcd"]).digest()).decode()
    assert coded.headers["unencoded-digest"] == f"sha-256=:{bare}:"
    assert "Available-Dictionary" in coded.headers["vary"]
    (tmp_path / "held.pcd").write_bytes(held)
    (tmp_path / "frame.zst").write_bytes(coded.content[len(head) :])
    patch = ["zstd", "-dqc", "--long=31", f"--patch-from={tmp_path / 'held.pcd'}", tmp_path / "frame.zst"]
    assert subprocess.run(patch, capture_output=True, check=True).stdout == two.old["point-cloud.pcd"]
    asking["Available-Dictionary"] = f":{base64.b64encode(bytes(32)).decode()}:"
    assert get().headers["content-encoding"] == "zstd", "a cloud that this map never had"


@pytest.mark.parametrize(
    ("held_bytes", "wanted_bytes", "is_coded"),
    [
        (1_000, 7_999_999, True),
        (1_000, 8_000_000, False),
        (8_000_000, 9_999_999, True),
        (8_000_000, 10_000_000, False),
    ],
)
def test_no_window_is_sent_that_a_client_may_refuse(
    admin: httpx.Client,
    by_hand: ByHand,
    client_for: ClientFor,
    tmp_path: Path,
    held_bytes: int,
    wanted_bytes: int,
    *,
    is_coded: bool,
) -> None:
    """A delta whose window is not below the limit of RFC 9842 is given as a file, never as a coding."""
    map_id = a_map(admin)
    held, wanted = (
        random.Random(n).randbytes(1 << 16) * (n // (1 << 16) + 1) for n in (held_bytes, wanted_bytes)
    )
    clouds = held[:held_bytes], wanted[:wanted_bytes]
    for cloud in clouds:
        built_revision(admin, by_hand, map_id, {"point-cloud.pcd": cloud})
    ok(admin.post(f"/v1/maps/{map_id}/revisions/2/publish", json={}))
    robot = client_for("robot", [map_id])
    where = f"/v1/maps/{map_id}/revisions/2"
    offer = base64.b64encode(hashlib.sha256(clouds[0]).digest()).decode()
    asking = {"Accept-Encoding": "dcz", "Available-Dictionary": f":{offer}:"}

    def coding() -> str | None:
        with robot.stream("GET", f"{where}/artifacts/point-cloud.pcd", headers=asking) as answer:
            assert answer.status_code == 200
            return answer.headers.get("content-encoding")

    assert coding() is None, "it has still to be made, or will never be sent"
    jobs = ok(admin.get("/v1/jobs", params={"kind": "make-delta", "map": map_id}))["items"]
    assert len(jobs) == (1 if is_coded else 0), "what would never be sent is not made for it"
    job = refused(robot.get(f"{where}/delta?from=1"), 503, "delta-not-ready")["job_id"]
    delta = make_delta(by_hand, job, tmp_path)
    assert coding() == ("dcz" if is_coded else None)
    assert robot.get(f"{where}/delta?from=1").content == delta


def test_a_delta_that_could_not_be_made_says_so(two: Two, by_hand: ByHand) -> None:
    where = f"{two.where}/2/delta?from=2"
    job_id = refused(two.robot.get(where), 503, "delta-not-ready")["job_id"]
    by_hand.fail(job_id, problem={"slug": "job-out-of-memory", "title": "x", "detail": "y"})
    answer = two.robot.get(where)
    assert int(answer.headers["retry-after"]) > 60
    assert "could not be made" in refused(answer, 503, "delta-not-ready")["detail"]
    refused(two.robot.get(f"{two.where}/2/delta?from=99"), 404, "revision-not-found")
    refused(two.robot.get(f"{two.where}/2/delta"), 422, "invalid-request")


def test_the_tiles_that_changed_rebuild_the_cloud(two: Two) -> None:
    told = ok(two.robot.get(f"{two.where}/2/changes?since=1"))
    assert (told["since"], told["revision"], told["tile_size_m"]) == (1, 2, 20)
    old = {path: content for path, content in two.old.items() if path.startswith("tiles/")}
    new = {path for path in two.new if path.startswith("tiles/")}
    fresh = told["added"] + [pair["after"] for pair in told["changed"]]
    gone = told["removed"] + [pair["before"] for pair in told["changed"]]
    assert {tile["path"] for tile in fresh} == new - set(old)
    assert {tile["path"] for tile in gone} == set(old) - new
    assert told["unchanged"] == len(new & set(old)) > 0
    for tile in fresh:
        got = two.robot.get(tile["url"])
        assert (sha256(got.content), len(got.content)) == (tile["sha256"], tile["size_bytes"])
        old[tile["path"]] = got.content
    manifest = ok(two.robot.get(f"{two.where}/2/artifacts/manifest.json"))
    header = two.new["point-cloud.pcd"].partition(b"DATA binary\n")[0] + b"DATA binary\n"
    records = [old[tile["path"]].partition(b"DATA binary\n")[2] for tile in manifest["tiles"]]
    assert header + b"".join(records) == two.new["point-cloud.pcd"]
    same = ok(two.robot.get(f"{two.where}/2/changes?since=2"))
    assert (same["added"], same["changed"], same["removed"]) == ([], [], [])
    refused(two.robot.get(f"{two.where}/2/changes?since=99"), 404, "revision-not-found")


def test_a_link_works_without_a_key_until_it_expires(two: Two) -> None:
    asked = {"path": "package.tar", "valid_s": "2"}
    link = ok(two.robot.get(f"{two.where}/2/link", params=asked))
    got = web.get(link["url"])
    assert (got.status_code, got.content) == (200, two.new["package.tar"])
    assert (link["sha256"], link["size_bytes"]) == (sha256(got.content), len(got.content))
    assert web.get(link["url"], headers={"Range": "bytes=0-9"}).content == got.content[:10]
    for part, other in (("package.tar", "point-cloud.pcd"), ("/2/", "/1/"), ("expires=", "expires=1")):
        refused(web.get(link["url"].replace(part, other)), 403, "link-not-valid")
    refused(web.get(link["url"].partition("?")[0]), 422, "invalid-request")
    time.sleep(2.2)
    assert "expired" in refused(web.get(link["url"]), 403, "link-not-valid")["detail"]


def test_a_link_dies_with_the_key_that_signed_it(
    two: Two, admin: httpx.Client, client_for: ClientFor
) -> None:
    made = ok(admin.post("/v1/keys", json={"name": "soon gone", "role": "robot"}), 201)
    signer = {"Authorization": f"Bearer {made['key']}"}
    asked = {"path": "point-cloud.pcd"}
    url = ok(admin.get(f"{two.where}/2/link", params=asked, headers=signer))["url"]
    assert web.head(url).status_code == 200
    assert admin.delete(f"/v1/keys/{made['id']}").status_code == 204
    refused(web.get(url), 403, "link-not-valid")
    refused(admin.get(f"{two.where}/2/link", params={"path": "nothing"}), 404, "artifact-not-found")
    stranger = client_for("robot", [a_map(admin)])
    refused(stranger.get(f"{two.where}/2/link", params=asked), 404, "map-not-found")


def test_a_delta_waits_in_the_turn_of_the_key_that_asked(admin: httpx.Client, by_hand: ByHand) -> None:
    """Fair turns then hold for them: what the product itself has to do waits for one of them at most."""
    map_id = a_map(admin)
    for n in range(4):
        built_revision(admin, by_hand, map_id, {"point-cloud.pcd": b"cloud %d" % n})
    made = ok(admin.post("/v1/keys", json={"name": "r", "role": "robot"}), 201)
    key_id, robot = made["id"], {"Authorization": f"Bearer {made['key']}"}
    where = f"/v1/maps/{map_id}/revisions"
    ok(admin.post(f"{where}/4/publish", json={"channel": "fleet"}))
    by_file = refused(admin.get(f"{where}/4/delta?from=1", headers=robot), 503, "delta-not-ready")["job_id"]
    offer = base64.b64encode(hashlib.sha256(b"cloud 1").digest()).decode()
    asking = {**robot, "Accept-Encoding": "dcz", "Available-Dictionary": f":{offer}:"}
    assert admin.get(f"{where}/4/artifacts/point-cloud.pcd", headers=asking).status_code == 200
    for n in (1, 4):
        ok(admin.post(f"{where}/{n}/publish", json={"channel": "stable"}))
    for n in (1, 3):
        ok(admin.post(f"{where}/{n}/publish", json={"channel": "beta"}))
    with by_hand.kernel.db.reading() as session:
        wanted = select(Job.id, Job.key_id).where(Job.map_id == map_id, Job.kind == "make-delta")
        keys = {row.id: row.key_id for row in session.execute(wanted)}
    assert keys[by_file] == key_id
    assert sorted(keys.values(), key=str) == sorted([key_id, key_id, None], key=str), "one was foreseen"
