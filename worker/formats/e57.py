"""E57 scans (ASTM E2807) of laser scanners and apps, read by libE57 through pye57."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pye57
from numpy.typing import NDArray

from service.domain.bounds import Bounds
from service.domain.errors import FileEmpty, FileMalformed, FileTruncated, HeaderMismatch
from worker.formats.scan_checks import check_count, cloud_of
from worker.geometry.scan.file_scan import FileScan, Statement

_HEADER_BYTES = 48
_MOST_STATIONS = 2_000
_E57 = Statement("z", 1.0, "E57 is in metres, by its standard, and z is up in it.")


def load_e57(path: Path, *, bounds: Bounds) -> FileScan:
    """Return the points of all stations of an E57 file, each placed by its pose, in the file's frame.

    Raises
    ------
    FileTruncated
        If the bytes end before the header's length.
    HeaderMismatch
        If a station promises more points than the file's bytes can hold.
    FileMalformed
        If the file breaks the format.
    FileEmpty, TooManyPoints, NotFinite
        As for every scan.
    """
    size = path.stat().st_size
    with path.open("rb") as source:
        head = source.read(_HEADER_BYTES)
    if len(head) < _HEADER_BYTES:
        raise FileTruncated(
            f"An E57 file has a header of {_HEADER_BYTES} bytes; this one has {size} bytes in all."
        )
    (length,) = struct.unpack("<Q", head[16:24])
    if length > size:
        raise FileTruncated(f"The E57 header promises {length} bytes; the file has {size}.")
    try:
        file = pye57.E57(str(path))
        try:
            points = _stations(file, size=size, bounds=bounds)
        finally:
            file.close()
    except (
        pye57.libe57.E57Exception,
        ValueError,
        KeyError,
        TypeError,
        AttributeError,
        RuntimeError,
    ) as error:
        raise FileMalformed(f"The E57 file breaks its format: {error!s:.160}.") from error
    return FileScan(cloud_of(points), "E57", _E57)


def _stations(file: Any, *, size: int, bounds: Bounds) -> NDArray[np.float64]:
    stations = int(file.scan_count)
    if stations == 0:
        raise FileEmpty("The E57 file holds no scan.")
    if stations > _MOST_STATIONS:
        raise FileMalformed(f"The E57 file holds {stations} scans; at most {_MOST_STATIONS} are read.")
    counts = [int(file.get_header(i).point_count) for i in range(stations)]
    check_count(sum(counts), bounds=bounds)
    if sum(counts) > 8 * size:
        raise HeaderMismatch(
            f"The E57 file promises {sum(counts)} points, more than its {size} bytes can hold."
        )
    parts = []
    for i, count in enumerate(counts):
        if count == 0:
            continue
        columns = file.read_scan(i, ignore_missing_fields=True)
        parts.append(np.stack([columns[f"cartesian{axis}"] for axis in "XYZ"], axis=1))
    return np.vstack(parts) if parts else np.zeros((0, 3))
