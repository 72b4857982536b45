"""What the largest files cost to read, beside the limits that they have by default: each has to be read."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from service.domain.bounds import Bounds
from service.domain.job_limits import JOB_MEMORY_BYTES, JobLimits
from service.domain.lifecycle import JobState
from service.domain.media import HEAD_BYTES
from service.domain.reading_cost import Promise, ReadingLimits
from service.settings import Settings
from tests.formats import scan_files
from tests.formats.cad_plans import draw_plan, new_drawing, saved
from tests.worker.workbench import Workbench
from worker.formats.pcd import write_pcd
from worker.geometry.cloud.point_cloud import PointCloud

pytestmark = pytest.mark.benchmark

MIB = 1 << 20
SEED = 20


def _hall(points: int) -> np.ndarray:
    """Return points on the floor and the walls of a hall of 120 x 80 x 8 m, with 5 mm of noise."""
    rng = np.random.default_rng(SEED)
    found = rng.uniform((0, 0, 0), (120, 80, 8), (points, 3))
    face = rng.integers(0, 6, points)
    for k, (axis, at) in enumerate([(2, 0.0), (0, 0.0), (0, 120.0), (1, 0.0), (1, 80.0), (0, 60.0)]):
        found[face == k, axis] = at
    return np.asarray(found + rng.normal(0, 0.005, found.shape))


def _pcd(points: int) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        write_pcd(folder / "hall.pcd", PointCloud.of(_hall(points)))
        return folder / "hall.pcd"

    return write


def _laz(points: int) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        scan_files.laz(folder / "hall.laz", _hall(points))
        return folder / "hall.laz"

    return write


def _png(width: int, height: int) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        sheet = Image.new("L", (width, height), 255)
        black = Image.new("L", (width // 2, 24), 0)
        for n in range(12):
            sheet.paste(black, (width // 4, height * (n + 1) // 14))
            sheet.paste(
                black.rotate(90, expand=True).crop((0, 0, 24, height // 3)),
                (width * (n + 1) // 14, height // 3),
            )
        sheet.save(folder / "sheet.png")
        return folder / "sheet.png"

    return write


def _dxf(plans: int) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        doc = new_drawing()
        for n in range(plans):
            draw_plan(doc, 1000.0, x=25.0 * (n % 60), y=15.0 * (n // 60))
        return saved(doc, folder / "site.dxf")

    return write


FILES: dict[str, Callable[[Path], Path]] = {
    "1.6 million points, PCD": _pcd(1_600_000),
    "10 million points, PCD": _pcd(10_000_000),
    "10 million points, LAZ": _laz(10_000_000),
    "100 Mpx, PNG": _png(12_500, 8_000),
    "20 MB of DXF": _dxf(4_400),
}


def _limits(path: Path) -> ReadingLimits:
    may = Settings()
    job = JobLimits(
        JOB_MEMORY_BYTES, may.job_cpu_s, may.job_wall_s, may.reading_memory_bytes, may.reading_cpu_s
    )
    head = path.read_bytes()[:HEAD_BYTES]
    promise = Promise.of(head, size_bytes=path.stat().st_size, bounds=Bounds())
    return ReadingLimits.of(promise, job, file_name=path.name)


@pytest.mark.parametrize("what", FILES)
def test_what_a_large_file_costs(tmp_path: Path, what: str) -> None:
    bench = Workbench(tmp_path / "data", f"sqlite:///{tmp_path}/groundplan.sqlite3")
    bench.prepare()
    path = FILES[what](tmp_path)
    limits = _limits(path)
    is_scan = path.suffix in {".pcd", ".laz"}
    with bench.worker():
        job_id = bench.add_scan(path) if is_scan else bench.add_drawing(path)
        job = bench.wait_final(job_id, patience_s=1800.0)
        while '"event": "job ended"' not in bench.log():
            time.sleep(0.1)
    ended = [
        json.loads(line) for line in bench.log().splitlines() if re.search(r'"event": "job ended"', line)
    ]
    took = ended[-1]
    print(
        f"\n{what}: {job.state}, {path.stat().st_size / MIB:.0f} MiB; {limits.promise.words()}: "
        f"{took['cpu_s']:.1f} of {limits.cpu_s:.0f} s of CPU, peak {took['peak_mib']} of "
        f"{limits.memory_bytes >> 20} MiB; {took['seconds']:.1f} s"
    )
    too_costly = job.problem is not None and job.problem["slug"] in {"reading-too-costly", "job-crashed"}
    assert not too_costly, job.problem
    assert job.state == JobState.SUCCEEDED or not is_scan, job.problem
