"""Exports made by a real worker, on both databases, read back by independent readers to the same points."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
import trimesh
from plyfile import PlyData

from service.domain.access import Actor
from service.domain.errors import ArtifactNotFound, ExportNotReady, RevisionNotFound
from service.domain.lifecycle import ExportFormat, JobState, Role
from service.usecases.download import CLOUD_PATH, artifact_file
from service.usecases.exports import ask_for_export, export_file
from tests.worker.workbench import Workbench, a_small_drawing
from worker.formats.export import LAS_STEP_M, write_laz, write_ply
from worker.formats.pcd import read_pcd
from worker.geometry.cloud.point_cloud import PointCloud

pytestmark = pytest.mark.slow


def test_a_worker_makes_each_export_once(bench: Workbench, tmp_path: Path) -> None:
    admin, files, jobs = Actor(bench.key_id, Role.ADMIN), {}, {}
    with bench.worker():
        drawing = bench.add_drawing(a_small_drawing(tmp_path / "plan.png"))
        assert bench.wait_final(drawing).state == JobState.SUCCEEDED
        assert bench.wait_final(bench.add_revision(drawing, floor=True)).state == JobState.SUCCEEDED
        for kind in ExportFormat:
            with bench.kernel.db.reading() as session, pytest.raises(ArtifactNotFound):
                export_file(bench.kernel, session, admin, map_id=bench.map_id, n=1, kind=kind)
            for _ in range(2):
                with bench.kernel.db.writing("ask-export") as session:
                    asked = ask_for_export(bench.kernel, session, admin, map_id=bench.map_id, n=1, kind=kind)
                    jobs.setdefault(kind, set()).add(asked.job.id)
            (job_id,) = jobs[kind]
            job = bench.wait_final(job_id)
            assert job.state == JobState.SUCCEEDED, job.problem
            with bench.kernel.db.reading() as session:
                files[kind] = export_file(bench.kernel, session, admin, map_id=bench.map_id, n=1, kind=kind)
    with bench.kernel.db.reading() as session:
        cloud = read_pcd(
            artifact_file(bench.kernel, session, admin, map_id=bench.map_id, n=1, path=CLOUD_PATH).path
        )
    _same_ply(files[ExportFormat.PLY].path, cloud)
    _same_laz(files[ExportFormat.LAZ].path, cloud)
    assert files[ExportFormat.LAZ].size_bytes < files[ExportFormat.PLY].size_bytes


def test_what_waits_says_so_and_what_is_not_there_too(sqlite_bench: Workbench) -> None:
    bench, admin = sqlite_bench, Actor(sqlite_bench.key_id, Role.ADMIN)
    with bench.kernel.db.writing("ask-export") as session, pytest.raises(RevisionNotFound):
        ask_for_export(bench.kernel, session, admin, map_id=bench.map_id, n=1, kind=ExportFormat.LAZ)
    assert ExportNotReady("...", retry_after_s=1).members == {"retry_after_s": 1}


def test_the_same_cloud_gives_the_same_bytes_and_large_coordinates_stay(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    points = (rng.uniform(-900.0, 900.0, (5000, 3))).astype(np.float32).astype(np.float64)
    cloud = PointCloud(points, rng.integers(0, 5, 5000).astype(np.uint32))
    for write, suffix, check in ((write_ply, "ply", _same_ply), (write_laz, "laz", _same_laz)):
        first, second = (tmp_path / f"{n}.{suffix}" for n in range(2))
        for path in (first, second):
            write(path, cloud)
        assert first.read_bytes() == second.read_bytes()
        check(first, cloud)


def _same_ply(path: Path, cloud: PointCloud) -> None:
    """Hold a PLY against the cloud: bit for bit, by two readers."""
    wanted = cloud.points.astype(np.float32)
    copy = path.with_name("copy.ply")  # the readers judge a file by its name
    read = PlyData.read(str(path))["vertex"]
    assert np.array_equal(np.column_stack([read[axis] for axis in "xyz"]), wanted)
    assert np.array_equal(read["label"], cloud.labels)
    if path.suffix == ".ply":
        copy = path
        loaded = trimesh.load(copy)
        assert np.array_equal(np.asarray(loaded.vertices, dtype=np.float32), wanted)


def _same_laz(path: Path, cloud: PointCloud) -> None:
    """Hold a LAZ against the cloud: within half a step, with every label."""
    with laspy.open(str(path)) as file:
        assert file.header.point_format.id == 6
        las = file.read()
    assert np.abs(np.column_stack([las.x, las.y, las.z]) - cloud.points).max() <= LAS_STEP_M / 2 + 1e-9
    assert np.array_equal(np.asarray(las.user_data), cloud.labels)
    assert set(np.asarray(las.classification)[cloud.labels == 3]) <= {2}
    assert set(np.asarray(las.classification)[cloud.labels == 1]) <= {6}
