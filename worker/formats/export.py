"""A cloud as a file of another format: LAZ for surveyors' programs, PLY for viewers."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import laspy
import numpy as np

from worker.geometry.cloud.point_cloud import Label, PointCloud

LAS_STEP_M = 1e-5
"""Coordinates in LAS are whole numbers of this [m]: 21 km around the origin, off by 5 micrometres at most."""

_LAS_CLASSES = {Label.FLOOR: 2, Label.WALL: 6}
_UNCLASSIFIED = 1
_NO_DATE = date(1970, 1, 1)


def write_ply(path: Path, cloud: PointCloud) -> None:
    """Write a cloud as binary PLY: `x y z` as float32 [m], and `label` as uint32.

    These are the very numbers of the cloud's PCD. Same cloud, same bytes.
    """
    fields = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("label", "<u4")])
    rows = np.zeros(len(cloud), dtype=fields)
    for column, name in enumerate("xyz"):
        rows[name] = cloud.points[:, column]
    rows["label"] = cloud.labels
    head = (
        "ply\nformat binary_little_endian 1.0\ncomment frame map, metres\n"
        f"element vertex {len(cloud)}\n"
        "property float x\nproperty float y\nproperty float z\nproperty uint label\nend_header\n"
    )
    path.write_bytes(head.encode("ascii") + rows.tobytes())


def write_laz(path: Path, cloud: PointCloud) -> None:
    """Write a cloud as LAZ 1.4, point format 6, the label in `user_data` and as a class where there is one.

    Coordinates are rounded to `LAS_STEP_M`. Same cloud, same bytes: no clock goes into the header.

    Notes
    -----
    ASPRS LAS 1.4 R15, table 17: 2 is ground, 6 building; all else is unclassified (1).
    """
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales = np.full(3, LAS_STEP_M)
    header.offsets = np.zeros(3)
    header.generating_software = "Groundplan"
    header.creation_date = _NO_DATE
    las = laspy.LasData(header)
    las.x, las.y, las.z = cloud.points.T
    classes = np.full(len(cloud), _UNCLASSIFIED, dtype=np.uint8)
    for label, code in _LAS_CLASSES.items():
        classes[cloud.labels == label] = code
    las.classification = classes
    las.user_data = cloud.labels.astype(np.uint8)
    las.return_number = np.ones(len(cloud), dtype=np.uint8)
    las.number_of_returns = np.ones(len(cloud), dtype=np.uint8)
    las.write(path, laz_backend=laspy.LazBackend.Lazrs)
