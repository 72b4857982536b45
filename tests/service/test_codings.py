"""Coded downloads: who is sent which form, with which tag and digests, and what they say of the bare file."""

from __future__ import annotations

import base64
import hashlib
import subprocess

import httpx
import pytest
from backports import zstd

from service.api.codings import dictionary_of, takes
from tests.server import ClientFor
from tests.service.asking import a_map, ok, refused
from tests.service.by_hand import CLOUD, ByHand

CODED = zstd.compress(CLOUD)


def digest(content: bytes) -> str:
    return f"sha-256=:{base64.b64encode(hashlib.sha256(content).digest()).decode()}:"


def tag(content: bytes) -> str:
    return f'"{hashlib.sha256(content).hexdigest()}"'


class Cloud:
    """Hold a cloud that is at hand bare and compressed."""

    def __init__(self, robot: httpx.Client, path: str) -> None:
        self.robot = robot
        self.path = path

    def get(self, accept: str | None, **headers: str) -> httpx.Response:
        """Return the answer, its body as it was sent."""
        sent = {name.replace("_", "-"): value for name, value in headers.items()}
        request = self.robot.build_request("GET", self.path, headers=sent)
        del request.headers["accept-encoding"]
        if accept is not None:
            request.headers["accept-encoding"] = accept
        with_body = self.robot.send(request, stream=True)
        with_body._content = b"".join(with_body.iter_raw())
        with_body.close()
        return with_body


@pytest.fixture(scope="module")
def cloud(admin: httpx.Client, by_hand: ByHand, client_for: ClientFor) -> Cloud:
    map_id = a_map(admin)
    made = ok(admin.post(f"/v1/maps/{map_id}/revisions", json={"drawing_id": by_hand.drawing(map_id)}), 202)
    by_hand.build(made["job"]["id"], more={"point-cloud.pcd.zst": CODED})
    return Cloud(client_for("robot", [map_id]), f"/v1/maps/{map_id}/revisions/1/artifacts/point-cloud.pcd")


@pytest.mark.parametrize("accept", ["zstd", "gzip, br, zstd;q=0.4", "*", "identity;q=0.5, zstd", "ZSTD"])
def test_who_takes_zstd_gets_it_with_its_own_tag(cloud: Cloud, accept: str) -> None:
    answer = cloud.get(accept)
    assert (answer.status_code, answer.content) == (200, CODED)
    assert answer.headers["content-encoding"] == "zstd"
    assert answer.headers["content-length"] == str(len(CODED))
    assert answer.headers["etag"] == tag(CODED)
    assert answer.headers["repr-digest"] == digest(CODED)
    assert answer.headers["unencoded-digest"] == digest(CLOUD)
    assert answer.headers["accept-ranges"] == "none"
    assert {"Accept-Encoding", "Available-Dictionary"} == set(answer.headers["vary"].split(", "))
    decoded = subprocess.run(["zstd", "-dcq"], input=answer.content, capture_output=True, check=True).stdout
    assert decoded == CLOUD
    head = cloud.robot.head(cloud.path, headers={"Accept-Encoding": accept})
    assert (head.headers["etag"], head.headers["content-length"]) == (tag(CODED), str(len(CODED)))


@pytest.mark.parametrize(
    "accept", [None, "", "identity", "gzip", "zstd;q=0", "zstd;q=0.2, identity", "zs td"]
)
def test_who_does_not_gets_the_bare_file(cloud: Cloud, accept: str | None) -> None:
    answer = cloud.get(accept)
    assert (answer.status_code, answer.content) == (200, CLOUD)
    assert "content-encoding" not in answer.headers
    assert answer.headers["etag"] == tag(CLOUD)
    assert answer.headers["repr-digest"] == answer.headers["unencoded-digest"] == digest(CLOUD)
    assert "Accept-Encoding" in answer.headers["vary"]


@pytest.mark.parametrize("accept", ["identity;q=0", "*;q=0", "gzip, *;q=0", "zstd;q=0, identity;q=0"])
def test_who_takes_no_form_is_told_what_there_is(cloud: Cloud, accept: str) -> None:
    for held in ({}, {"If_None_Match": tag(CLOUD)}, {"If_Match": '"x"'}):
        problem = refused(cloud.get(accept, **held), 406, "coding-not-offered")
        assert problem["offered"] == ["zstd", "identity"]
    assert cloud.robot.head(cloud.path, headers={"Accept-Encoding": accept}).status_code == 406


def test_a_part_of_a_file_is_never_coded(cloud: Cloud) -> None:
    problem = refused(cloud.get("zstd, identity;q=0", Range="bytes=0-9"), 406, "coding-not-offered")
    assert problem["offered"] == ["identity"]
    assert cloud.get("zstd, identity;q=0").content == CODED


def test_only_the_bare_file_has_ranges(cloud: Cloud) -> None:
    cut = cloud.get("zstd", Range="bytes=10-19", If_Range=tag(CLOUD))
    assert (cut.status_code, cut.content) == (206, CLOUD[10:20])
    assert "content-encoding" not in cut.headers
    assert cut.headers["repr-digest"] == digest(CLOUD)
    assert "unencoded-digest" not in cut.headers
    of_the_coded = cloud.get("zstd", Range="bytes=10-19", If_Range=tag(CODED))
    assert (of_the_coded.status_code, of_the_coded.content) == (200, CLOUD)


@pytest.mark.parametrize("held", [CODED, CLOUD])
def test_who_has_either_form_is_told_so(cloud: Cloud, held: bytes) -> None:
    answer = cloud.get("zstd", If_None_Match=tag(held))
    assert (answer.status_code, answer.content, answer.headers["etag"]) == (304, b"", tag(held))
    assert answer.headers["unencoded-digest"] == digest(CLOUD)
    assert "Accept-Encoding" in answer.headers["vary"]
    assert cloud.get("identity", If_None_Match=tag(CODED)).status_code == 200


def test_whole_clouds_are_offered_as_dictionaries_for_the_maps_later_ones(cloud: Cloud) -> None:
    later = cloud.path.replace("/revisions/1/", "/revisions/*/")
    offer = f'match="{later}", id="{hashlib.sha256(CLOUD).hexdigest()}"'
    for accept in ("zstd", "identity"):
        assert cloud.get(accept).headers["use-as-dictionary"] == offer
    assert "use-as-dictionary" not in cloud.get("zstd", Range="bytes=0-9").headers
    other = cloud.robot.get(cloud.path.replace("point-cloud.pcd", "report.json"))
    assert "use-as-dictionary" not in other.headers


def test_the_headers_by_themselves() -> None:
    assert not takes("*;q=0", "zstd")
    assert takes("identity;q=0, *", "dcz")
    assert dictionary_of(f" :{base64.b64encode(bytes(32)).decode()}: ") == "00" * 32
    for wrong in (None, "", ":", "::", f":{base64.b64encode(bytes(31)).decode()}:", ":~:", "00" * 32):
        assert dictionary_of(wrong) is None
