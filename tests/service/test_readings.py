"""What becomes of uploads once a worker has read them: files to look at, and readings that are replaced."""

from __future__ import annotations

import hashlib
import signal
from collections.abc import Iterator
from dataclasses import astuple
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from PIL import Image, ImageDraw
from pypcd4 import PointCloud

from service.domain.scale_hint import KnownLength, ScaleHint
from tests import files
from tests.factories import a_drawing_png
from tests.forked import forked
from tests.patience import PATIENCE_S
from tests.server import Server, environment
from tests.service.asking import ended


@pytest.fixture(scope="module")
def worker(server: Server) -> Iterator[None]:
    process = forked("worker", env=environment(server.settings))
    yield
    process.send_signal(signal.SIGTERM)
    process.wait(timeout=PATIENCE_S)


@pytest.fixture(scope="module")
def map_id(admin: httpx.Client) -> str:
    identifier: str = admin.post("/v1/maps", json={"site": "plant", "name": "readings"}).json()["id"]
    return identifier


def spread(walls: dict[str, Any]) -> float:
    points = [
        point
        for feature in walls["features"]
        if feature["geometry"]["type"] == "LineString"
        for point in feature["geometry"]["coordinates"]
    ]
    return float(np.ptp(np.array(points)[:, :2], axis=0).max())


@pytest.mark.usefixtures("worker")
def test_a_drawing_is_read_and_read_again(admin: httpx.Client, map_id: str, tmp_path: Path) -> None:
    measured = KnownLength(*astuple(a_drawing_png(tmp_path / "hall.png")))
    true = ScaleHint(known_length=measured).metres_per_px()
    sent = admin.post(
        f"/v1/maps/{map_id}/drawings",
        files={"file": ("hall.png", (tmp_path / "hall.png").read_bytes())},
        data={"metres_per_unit": repr(true)},
    )
    assert sent.status_code == 202, sent.text
    assert ended(admin, sent.json()["job"]["id"])["state"] == "succeeded"
    at = sent.headers["location"]
    first = admin.get(at).json()
    assert first["reading"]["scale"]["metres_per_unit"] == true
    picture = admin.get(first["files"]["preview"])
    assert picture.content.startswith(files.PNG_MAGIC)
    assert picture.headers["etag"] == f'"{hashlib.sha256(picture.content).hexdigest()}"'
    assert (
        admin.get(first["files"]["preview"], headers={"If-None-Match": picture.headers["etag"]}).status_code
        == 304
    )
    assert admin.head(first["files"]["preview"]).headers["content-length"] == str(len(picture.content))
    walls = admin.get(first["files"]["walls"])
    assert walls.headers["content-type"] == "application/geo+json"
    width = spread(walls.json())
    assert width > 5.0
    assert admin.get(first["files"]["removed"]).json()["type"] == "FeatureCollection"

    failed = ended(admin, admin.patch(at, json={"page": 9}).json()["job"]["id"])
    assert failed["problem"]["type"].endswith("/problems/page-not-found")
    kept = admin.get(at).json()
    assert (kept["reading"], kept["files"]) == (first["reading"], first["files"])
    assert admin.get(first["files"]["walls"]).content == walls.content

    again = admin.patch(at, json={"page": 1, "scale": {"metres_per_unit": 1.05 * true}})
    assert ended(admin, again.json()["job"]["id"])["state"] == "succeeded"
    assert admin.get(at).json()["reading"]["scale"]["metres_per_unit"] == 1.05 * true
    assert spread(admin.get(first["files"]["walls"]).json()) == pytest.approx(1.05 * width, rel=0.005)


@pytest.mark.usefixtures("worker")
def test_a_scale_that_nobody_gave_is_found_on_the_sheet_or_unknown(
    admin: httpx.Client, map_id: str, tmp_path: Path
) -> None:
    measured = KnownLength(*astuple(a_drawing_png(tmp_path / "hall.png")))
    bare = Image.new("L", (640, 600), 255)
    ImageDraw.Draw(bare).rectangle((100, 100, 540, 500), outline=0, width=12)
    bare.save(tmp_path / "bare.png")
    scales = []
    for name in ("hall.png", "bare.png"):
        content = (tmp_path / name).read_bytes()
        sent = admin.post(f"/v1/maps/{map_id}/drawings", files={"file": (name, content)})
        assert ended(admin, sent.json()["job"]["id"])["state"] == "succeeded"
        scales.append(admin.get(sent.headers["location"]).json()["reading"]["scale"])
    true = ScaleHint(known_length=measured).metres_per_px()
    assert (scales[0]["state"], scales[1]["state"]) == ("found", "unknown")
    assert scales[0]["metres_per_unit"] == pytest.approx(true, rel=0.005)
    assert scales[1]["metres_per_unit"] is None


@pytest.mark.usefixtures("worker")
def test_a_scan_is_read(admin: httpx.Client, map_id: str, tmp_path: Path) -> None:
    points = files.room(20_000)
    sent = admin.post(f"/v1/maps/{map_id}/scans", files={"file": ("room.pcd", files.pcd(points))})
    assert ended(admin, sent.json()["job"]["id"])["state"] == "succeeded"
    scan = admin.get(sent.headers["location"]).json()
    assert scan["reading"]["points"] == len(points)
    assert scan["reading"]["extent_m"]["max"] == pytest.approx([6.0, 4.0, 2.5], abs=0.02)
    assert admin.get(scan["files"]["preview"]).content.startswith(files.PNG_MAGIC)
    downloaded = tmp_path / "points.pcd"
    downloaded.write_bytes(admin.get(scan["files"]["points"]).content)
    thinned = PointCloud.from_path(downloaded).numpy(("x", "y", "z"))
    assert 0 < len(thinned) <= len(points)
    assert np.ptp(thinned, axis=0) == pytest.approx([6.0, 4.0, 2.5], abs=0.03)
