"""The loop over the public HTTP API, a function a step: what the author of a client would write."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from demo.client import Client
from demo.console import expect
from demo.sheet import KnownLength
from service.domain.transform import Transform

_BLOCK = 1 << 16


def make_map(admin: Client, *, site: str, name: str) -> str:
    """Return the id of a new map."""
    map_id: str = admin.post("/v1/maps", {"site": site, "name": name})["id"]
    return map_id


def make_key(admin: Client, role: str, map_id: str) -> Client:
    """Return a client with a new key of a role, for one map."""
    made = admin.post("/v1/keys", {"name": f"demo {role}", "role": role, "map_ids": [map_id]})
    return Client(admin.address, made["key"])


def read_drawing(client: Client, map_id: str, content: bytes, *, clicked: KnownLength) -> dict[str, Any]:
    """Return the drawing, uploaded with its known length and read."""
    places = (clicked.x1, clicked.y1, clicked.x2, clicked.y2, clicked.length_m)
    answer = client.post(
        f"/v1/maps/{map_id}/drawings",
        files={"file": ("drawing.png", content, "image/png")},
        data={"known_length": ",".join(repr(value) for value in places)},
    )
    client.done(answer["job"])
    return client.get(f"/v1/drawings/{answer['drawing']['id']}")


def build_revision(client: Client, map_id: str, *, drawing_id: str, recipe: dict[str, Any]) -> int:
    """Return the number of a new revision, built from the drawing alone and ready."""
    body = {"drawing_id": drawing_id, "recipe": recipe}
    answer = client.post(f"/v1/maps/{map_id}/revisions", body)
    client.done(answer["job"])
    n: int = answer["revision"]["n"]
    return n


def read_scan(client: Client, map_id: str, content: bytes) -> dict[str, Any]:
    """Return the scan, uploaded and read."""
    files = {"file": ("scan.ply", content, "application/octet-stream")}
    answer = client.post(f"/v1/maps/{map_id}/scans", files=files)
    client.done(answer["job"])
    return client.get(f"/v1/scans/{answer['scan']['id']}")


def place_scan(client: Client, scan_id: str, *, revision: int, rough: Transform) -> dict[str, Any]:
    """Return the finished placement of a scan on a revision, from a rough pose."""
    x, y, z = (float(value) for value in rough.translation)
    pose = {"x_m": x, "y_m": y, "z_m": z, "yaw_rad": rough.rpy[2]}
    answer = client.post(f"/v1/scans/{scan_id}/placements", {"revision": revision, "rough_pose": pose})
    client.done(answer["job"])
    placement = client.get(f"/v1/placements/{answer['placement']['id']}")
    expect(placement["T_map_scan"], f"the placement has no pose: {placement['verdict']}")
    return placement


def pose_of(placement: dict[str, Any]) -> Transform:
    """Return `T_map_scan` of a finished placement."""
    return Transform(np.array(placement["T_map_scan"], dtype=np.float64))


def accept(client: Client, placement_id: str, *, reviewed: bool = False) -> int:
    """Return the number of the revision that accepting a placement made, ready."""
    answer = client.post(f"/v1/placements/{placement_id}/accept", {"reviewed": reviewed})
    client.done(answer["job"])
    n: int = answer["revision"]["n"]
    return n


def gates(admin: Client, map_id: str, n: int) -> list[str]:
    """Return what stands against publishing a revision on channel `stable`, as sentences."""
    found = admin.get(f"/v1/maps/{map_id}/revisions/{n}/gates?channel=stable")["gates"]
    return [gate["message"] for gate in found]


def publish(admin: Client, map_id: str, n: int, *, override: str | None = None) -> None:
    """Point channel `stable` to a revision; `override` is the word of an admin for doing it all the same."""
    body: dict[str, Any] = {"channel": "stable"}
    if override is not None:
        body["override"] = {"reason": override}
    admin.post(f"/v1/maps/{map_id}/revisions/{n}/publish", body)


def artifacts(client: Client, map_id: str, n: int) -> dict[str, dict[str, Any]]:
    """Return the files of a ready revision by their path."""
    revision = client.get(f"/v1/maps/{map_id}/revisions/{n}")
    expect(revision["status"] == "ready", f"revision {n} is {revision['status']}")
    listed = client.get(f"/v1/maps/{map_id}/revisions/{n}/artifacts")["items"]
    return {item["path"]: item for item in listed}


def poll(robot: Client, map_id: str, *, known_etag: str | None) -> tuple[int | None, str]:
    """Return which revision is published and the pointer's ETag; None if it is the one already known."""
    headers = {} if known_etag is None else {"If-None-Match": known_etag}
    where = f"/v1/maps/{map_id}/published?channel=stable"
    answer = robot.request("GET", where, expected=(200, 304), headers=headers)
    told = None if answer.status_code == httpx.codes.NOT_MODIFIED else int(answer.json()["revision"])
    return told, answer.headers["ETag"]


@dataclass(frozen=True)
class Download:
    """Hold a verified file: where it lies, its SHA-256, its size, and where the transfer was cut [bytes]."""

    path: Path
    sha256: str
    size: int
    cut_at: int


def download(robot: Client, map_id: str, n: int, *, name: str, to: Path) -> Download:
    """Return an artifact that was fetched in two parts, as after a Wi-Fi drop, and verified.

    Raises
    ------
    DemoFailed
        If its SHA-256 is not that of the artifact list and of the ETag, or the server would send it again
        to one who has it.
    """
    promised = artifacts(robot, map_id, n)[name]["sha256"]
    source = f"/v1/maps/{map_id}/revisions/{n}/artifacts/{name}"
    first = robot.request("GET", source, expected=(206,), headers={"Range": f"bytes=0-{_BLOCK - 1}"})
    etag = first.headers["ETag"]
    resume = {"Range": f"bytes={len(first.content)}-", "If-Range": etag}
    content = first.content + robot.request("GET", source, expected=(206,), headers=resume).content
    digest = hashlib.sha256(content).hexdigest()
    expect(digest == promised, f"{name}: SHA-256 {digest}, but the artifact list promised {promised}")
    expect(etag == f'"{promised}"', f"{name}: the ETag {etag} is not the SHA-256 {promised}")
    robot.request("GET", source, expected=(304,), headers={"If-None-Match": etag})
    to.write_bytes(content)
    return Download(to, digest, len(content), len(first.content))
