"""Read a tablet scan (paper, section 2.3, step 1): its points, extent, and files for viewers."""

from __future__ import annotations

import numpy as np

from service.db.models import Scan
from service.domain.scan_options import ScanOptions
from service.domain.scan_reading import ScanReading, ViewerCloud
from service.usecases.record_scan_reading import record_scan_reading
from worker.context import JobContext
from worker.formats.pcd import write_pcd
from worker.formats.preview import LAYER, Drawn, write_preview
from worker.formats.scan import read_upright_scan
from worker.formats.upright import write_upright
from worker.geometry.cloud.places import row_keys, smallest_that_fits
from worker.geometry.cloud.point_cloud import Label, PointCloud, extent_of
from worker.geometry.cloud.voxel_grid import filter_cloud, voxel_index
from worker.geometry.scan.upright import UprightScan

_VIEWER_POINTS = 100_000
_FINEST_M = 0.02
_COARSEN = 1.5


def read_scan(context: JobContext) -> None:
    """Read the scan and record its reading.

    1. read the uploaded bytes, whatever kind they say they are
    2. find its unit, its up axis, floor and ceiling, and the points that stand alone
    3. thin them for viewers, in the file's axes, and draw them upright from above
    4. keep these files as blobs, and all the points with what was found, for placements and builds
    5. record the reading with the end of the job
    """
    with context.kernel.db.reading() as session:
        scan = session.get_one(Scan, context.attempt.subject_id)
        path, options = (
            context.uploaded(scan.blob_sha256, scan.file_name),
            ScanOptions.from_json(scan.options),
        )
    context.begin_reading(path)
    upright = read_upright_scan(path, context.bounds, options=options)
    context.progress("thin", 0.5)
    thin, voxel_size = _thinned(upright)
    context.progress("write", 0.8)
    folder = context.folder("reading")
    write_pcd(folder / "points.pcd", thin)
    seen = upright.frame.T_upright_scan.apply(thin.points)
    low, high = seen.min(axis=0), seen.max(axis=0)
    write_preview(
        folder / "preview.png",
        [Drawn(LAYER, points=seen[:, :2])],
        low=(float(low[0]), float(low[1])),
        high=(float(high[0]), float(high[1])),
    )
    write_upright(folder / "upright.npz", upright)
    names = ("points.pcd", "preview.png", "upright.npz")
    files = {name: context.kernel.blobs.adopt(folder / name) for name in names}
    reading = _reading(upright, thin, voxel_size).to_json()
    with context.kernel.db.writing("record-scan-reading") as session:
        record_scan_reading(context.kernel, session, context.attempt, reading=reading, files=files)


def _thinned(upright: UprightScan) -> tuple[PointCloud, float]:
    """Return at most 100,000 points in frame `scan` without outliers, and the voxel size [m] they have."""
    kept = ~upright.outliers
    cloud = PointCloud(upright.scan.points[kept], upright.scan.labels[kept])
    few = cloud.points[:: max(1, len(cloud) // (3 * _VIEWER_POINTS))]

    def voxels(step: int) -> int:
        count = 0
        for points in (few, cloud.points):  # where a few points fill too many, all need not be looked at
            count = len(np.unique(row_keys(voxel_index(points, _FINEST_M * _COARSEN**step))))
            if count > _VIEWER_POINTS:
                break
        return count

    voxel_size = _FINEST_M * _COARSEN ** smallest_that_fits(voxels, _VIEWER_POINTS)
    return filter_cloud(cloud, voxel_size, label=Label.UNKNOWN), voxel_size


def _reading(upright: UprightScan, thin: PointCloud, voxel_size: float) -> ScanReading:
    return ScanReading(
        frame="scan",
        points=len(upright.scan),
        extent_m=extent_of(upright.scan),
        viewer=ViewerCloud(len(thin), round(voxel_size, 4)),
        outliers=int(upright.outliers.sum()),
        scan_frame=upright.frame.told(),
        findings=upright.findings(),
    )
