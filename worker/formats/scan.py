"""Tablet scans of any kind that is read here, told apart by their own bytes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from service.domain.bounds import Bounds
from service.domain.errors import FileEmpty, UnsupportedMedia
from service.domain.findings import Finding
from worker.formats.pcd import read_pcd
from worker.formats.ply import read_ply
from worker.geometry.cloud.point_cloud import PointCloud

_LARGEST_EXTENT = 500.0
_SMALLEST_EXTENT = 0.3
_PCD_STARTS = (b"# .PCD", b"VERSION", b"FIELDS", b"#.PCD")


def read_scan(path: Path, bounds: Bounds | None = None) -> PointCloud:
    """Return the points of a PLY or PCD file, whatever its name says, in the file's own units and axes.

    Parameters
    ----------
    path : Path
        The file.
    bounds : Bounds, optional
        The most points to read.

    Returns
    -------
    PointCloud
        N >= 1 points. That they are metres with z up is not checked here: see `scan_findings`.

    Raises
    ------
    UnsupportedMedia
        If the bytes begin like neither.
    FileEmpty
        If the file has no bytes, or no point.
    Rejected
        As `read_ply` and `read_pcd` do.
    """
    with Path(path).open("rb") as file:
        head = file.read(512)
    if not head:
        raise FileEmpty("The scan has no bytes.")
    if head.startswith((b"ply\n", b"ply\r")):
        return read_ply(path, bounds or Bounds())
    if head.lstrip().startswith(_PCD_STARTS) or (head.startswith(b"#") and b"\nVERSION" in head):
        return read_pcd(path, bounds or Bounds())
    raise UnsupportedMedia("The scan is neither a PLY nor a PCD file, by its own first bytes.")


def scan_findings(scan: PointCloud) -> tuple[Finding, ...]:
    """Return remarks about a scan's units and up axis; it is taken as metres with z up all the same.

    Parameters
    ----------
    scan : PointCloud
        As it was read.
    """
    extent = scan.points.max(axis=0) - scan.points.min(axis=0)
    largest = float(extent.max())
    members = {"extent": np.round(extent, 3).tolist()}
    findings = []
    if largest > _LARGEST_EXTENT:
        message = f"The scan reaches over {largest:.0f} units: it is probably in millimetres, read as metres."
        findings.append(Finding("scan-units-doubtful", "warning", message, members))
    elif largest < _SMALLEST_EXTENT:
        message = f"The scan reaches over {largest:.3f} units only: it is probably not in metres."
        findings.append(Finding("scan-units-doubtful", "warning", message, members))
    elif extent[2] > 2.0 * max(extent[0], extent[1]):
        message = "The scan is more than twice as high as wide: its up axis is probably not z."
        findings.append(Finding("scan-up-axis-doubtful", "warning", message, members))
    return tuple(findings)
