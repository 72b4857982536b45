"""Two states of a small hall as real artifacts, and the worker's part for deltas, played by hand."""

from __future__ import annotations

from pathlib import Path

import httpx
import numpy as np

from service.db.deltas import Delta
from service.domain.recipe import Recipe
from service.usecases.deltas import dcz_sha256, record_delta
from tests.service.asking import ok
from tests.service.by_hand import ByHand
from worker.formats.artifacts import write_artifacts
from worker.formats.delta import write_delta
from worker.geometry.cloud.merge import PlacedLayer
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.drawing.reading.reading import Wall


def hall_files(directory: Path, *, machine_x: float) -> dict[str, bytes]:
    """Return the artifacts of a hall of 50 x 30 m with one machine."""
    directory.mkdir(parents=True)
    corners = np.array([[0.0, 0.0], [50.0, 0.0], [50.0, 30.0], [0.0, 30.0], [0.0, 0.0]])
    walls = [Wall.of(corners[i : i + 2], thickness=0.2) for i in range(4)]
    machine = np.random.default_rng(5).uniform(0, 2, (3000, 3)) + np.array([machine_x, 11.0, 0.0])
    layers = [PlacedLayer("press", PointCloud.of(machine))]
    paths = write_artifacts(directory, walls=walls, recipe=Recipe(voxel_size_m=0.2), layers=layers, inputs={})
    return {path.relative_to(directory).as_posix(): path.read_bytes() for path in paths}


def built_revision(admin: httpx.Client, by_hand: ByHand, map_id: str, files: dict[str, bytes]) -> int:
    """Return the number of a new ready revision with these files."""
    body = {"drawing_id": by_hand.drawing(map_id)}
    made = ok(admin.post(f"/v1/maps/{map_id}/revisions", json=body), 202)
    by_hand.build(made["job"]["id"], cloud=files["point-cloud.pcd"], more=files)
    n: int = made["revision"]["n"]
    return n


def make_delta(by_hand: ByHand, job_id: str, folder: Path) -> bytes:
    """End the job of a delta well, and return the delta."""
    attempt = by_hand.claim(job_id)
    blobs = by_hand.kernel.blobs
    with by_hand.kernel.db.reading() as session:
        row = session.get_one(Delta, attempt.subject_id)
        held, old, new = row.from_sha256, blobs.path(row.from_sha256), blobs.path(row.to_sha256)
    path = folder / f"{job_id}.zst"
    write_delta(path, old=old, new=new)
    content = path.read_bytes()
    coded_sha256 = dcz_sha256(held, path)
    stored = blobs.adopt(path)
    with by_hand.kernel.db.writing("record-delta") as session:
        record_delta(by_hand.kernel, session, attempt, stored=stored, coded_sha256=coded_sha256)
    return content
