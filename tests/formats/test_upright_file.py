"""A scan as its job has read it, kept as a file: the same points, frame and outliers come back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from service.domain.scan_options import ScanOptions
from worker.formats.scan import read_upright_scan
from worker.formats.upright import load_upright, write_upright
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.scan.upright import UprightScan


def a_room(rng: np.random.Generator) -> np.ndarray:
    walls = rng.uniform((0.0, 0.0, 0.0), (4.0, 3.0, 2.4), (6000, 3))
    walls[np.arange(6000), rng.integers(0, 3, 6000)] *= 0.0
    return np.vstack([walls, [[20.0, 20.0, 2.0], [-9.0, 15.0, 1.0]]])


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_a_scan_comes_back_bit_by_bit(tmp_path: Path, kind: type[np.floating]) -> None:
    points = a_room(np.random.default_rng(3)).astype(kind).astype(np.float64)
    path = tmp_path / "scan.xyz"
    np.savetxt(path, points, fmt="%.17g")
    read = read_upright_scan(path, options=ScanOptions.of("y", None))
    kept = tmp_path / "upright.npz"
    write_upright(kept, read)
    again = load_upright(kept)
    assert isinstance(again, UprightScan)
    assert again.scan.points.tobytes() == read.scan.points.tobytes() == points.tobytes()
    assert again.scan.labels.tobytes() == read.scan.labels.tobytes()
    np.testing.assert_array_equal(np.flatnonzero(again.outliers), [6000, 6001])
    np.testing.assert_array_equal(again.outliers, read.outliers)
    assert again.frame.T_upright_scan.matrix.tobytes() == read.frame.T_upright_scan.matrix.tobytes()
    assert again.frame.told().to_json() == read.frame.told().to_json()
    assert kept.stat().st_size < len(points) * (3 * kind().nbytes + 2) + 4000


def test_labels_of_a_scan_are_kept(tmp_path: Path) -> None:
    points = a_room(np.random.default_rng(4))
    plain = tmp_path / "scan.xyz"
    np.savetxt(plain, points)
    read = read_upright_scan(plain)
    labels = np.arange(len(points), dtype=np.uint32)
    labelled = UprightScan(PointCloud(read.scan.points, labels), read.frame, read.outliers)
    write_upright(tmp_path / "upright.npz", labelled)
    np.testing.assert_array_equal(load_upright(tmp_path / "upright.npz").scan.labels, labels)
