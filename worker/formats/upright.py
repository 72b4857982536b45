"""A scan that was made upright, kept as a file of ours: who needs it again does not find all that anew."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.scan.upright import ScanFrame, UprightScan


def write_upright(path: Path, upright: UprightScan) -> None:
    """Write a scan with its frame and its outliers as NumPy's NPZ.

    Points that float32 holds exactly, as those of most files, are written as float32.
    """
    points = upright.scan.points
    short = points.astype(np.float32)
    frame = json.dumps(upright.frame.told().to_json()).encode()
    with path.open("wb") as file:
        np.savez(
            file,
            points=short if np.array_equal(short, points) else points,
            labels=_narrow(upright.scan.labels),
            outliers=np.packbits(upright.outliers),
            frame=np.frombuffer(frame, dtype=np.uint8),
        )


def load_upright(path: Path) -> UprightScan:
    """Return the scan that `write_upright` wrote, its points bit by bit the same."""
    with np.load(path, allow_pickle=False) as kept:
        points = kept["points"].astype(np.float64)
        labels = kept["labels"].astype(np.uint32)
        outliers = np.unpackbits(kept["outliers"], count=len(points)).astype(np.bool_)
        frame = ScanFrame.from_json(json.loads(kept["frame"].tobytes()))
    return UprightScan(PointCloud(points, labels), frame, outliers)


def _narrow(labels: NDArray[np.uint32]) -> NDArray[np.unsignedinteger]:
    """Return labels in the fewest bytes that hold them."""
    return labels.astype(np.min_scalar_type(int(labels.max(initial=0))))
