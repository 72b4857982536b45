"""Small builders that several tests share, each with a known truth."""

from __future__ import annotations

from pathlib import Path

from demo.hall import Hall, synthetic_hall
from demo.sheet import KnownLength, drawing_png, known_length
from demo.survey import ply_bytes, scan_of_new_machine
from worker.geometry.lidar.tablet import TabletScan

__all__ = ["Hall", "a_drawing_png", "a_scan_ply", "synthetic_hall"]


def a_drawing_png(path: Path, *, seed: int = 1) -> KnownLength:
    """Write the drawing of a synthetic hall and return its known length."""
    hall = synthetic_hall(seed)
    path.write_bytes(drawing_png(hall))
    return known_length(hall)


def a_scan_ply(path: Path, *, seed: int = 1) -> TabletScan:
    """Write the tablet scan of a synthetic hall's new machine and return it with its truth."""
    scan = scan_of_new_machine(synthetic_hall(seed), seed=seed)
    path.write_bytes(ply_bytes(scan.cloud.points))
    return scan
