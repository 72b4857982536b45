"""LAS and LAZ point clouds (ASPRS), read in pieces by laspy."""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Any

import laspy
import numpy as np
from numpy.typing import NDArray

from service.domain.bounds import Bounds
from service.domain.errors import FileMalformed, FileTruncated, HeaderMismatch, NotFinite, Rejected
from worker.formats.scan_checks import check_count, cloud_of
from worker.geometry.scan.file_scan import FileScan, Statement

_PIECE = 1_000_000
_LEAST_HEADER = 227
_LEAST_RECORD, _LEAST_EXTENDED = 54, 60
_PROJECTED_UNIT_KEY = 3076
_GEO_UNITS = {9001: 1.0, 9002: 0.3048, 9003: 1200.0 / 3937.0}
_WKT_UNIT = re.compile(r'(?:LENGTHUNIT|UNIT)\["([^"]*)",\s*([0-9.eE+-]+)')

_BROKEN = (
    laspy.errors.LaspyException,
    ValueError,
    TypeError,
    LookupError,
    ArithmeticError,
    AttributeError,
    AssertionError,
    OSError,
    RuntimeError,
    struct.error,
)
"""What laspy raises on files that break the format."""


def load_las(path: Path, *, bounds: Bounds) -> FileScan:
    """Return the points of a LAS or LAZ file, scaled and moved as its header says.

    Raises
    ------
    FileTruncated
        If the bytes end before the header's number of points.
    HeaderMismatch
        If the header promises more variable length records than the bytes between it and the points hold.
    FileMalformed
        If the file breaks the format, or its compressed points cannot be unpacked.
    FileEmpty, TooManyPoints, NotFinite
        As for every scan.

    Notes
    -----
    z is up by the format's use. The unit is the one of the file's coordinate system (WKT or GeoTIFF keys),
    where it has one.
    """
    size = path.stat().st_size
    if size < _LEAST_HEADER:
        raise FileTruncated(
            f"A LAS file has a header of {_LEAST_HEADER} bytes; this one has {size} bytes in all."
        )
    with path.open("rb") as head:
        _check_records(head.read(_LEAST_HEADER + 148), size=size)
    try:
        with laspy.open(path) as file:
            header = file.header
            _check_header(header, size=size, bounds=bounds)
            points = _read(file, int(header.point_count), packed=bool(header.are_points_compressed))
            statement = _statement(header)
    except Rejected:
        raise
    except _BROKEN as error:
        raise FileMalformed(
            f"The LAS file breaks its format: {type(error).__name__} {error!s:.150}."
        ) from error
    return FileScan(cloud_of(points), "LAS", statement)


def _check_records(head: bytes, *, size: int) -> None:
    """Refuse places and numbers of records that have no room: laspy allocates whatever they are.

    Notes
    -----
    LAS 1.4 R15, table 3: the header's size at byte 94, the points' offset at 96, the number of records at
    100; from version 1.4 the extended records' start at 235 and their number at 243.
    """
    header_bytes, points_at, records = struct.unpack_from("<HII", head, 94)
    if points_at > size:
        raise FileTruncated(f"The LAS points begin at byte {points_at}; the file has {size}.")
    room = points_at - header_bytes
    if records * _LEAST_RECORD > max(room, 0):
        raise HeaderMismatch(
            f"The LAS header promises {records} variable length records; {max(room, 0)} bytes lie between it "
            "and the points."
        )
    if head[25] >= 4 and len(head) >= 247:  # the minor version
        start, extended = struct.unpack_from("<QI", head, 235)
        if extended * _LEAST_EXTENDED > max(size - start, 0):
            raise HeaderMismatch(
                f"The LAS header promises {extended} extended records from byte {start}; the file has {size}."
            )


def _check_header(header: Any, *, size: int, bounds: Bounds) -> None:
    count = int(header.point_count)
    check_count(count, bounds=bounds)
    if not (
        np.isfinite(header.scales).all() and np.isfinite(header.offsets).all() and (header.scales != 0).all()
    ):
        raise NotFinite("The LAS header's scale or offset is zero or not a finite number.", points=count)
    needed = int(header.offset_to_point_data) + (
        count // 4_000 if header.are_points_compressed else count * int(header.point_format.size)
    )
    if size < needed:
        raise FileTruncated(
            f"The header promises {count} points, which need {needed} bytes or more; the file has {size}."
        )


def _read(file: Any, count: int, *, packed: bool) -> NDArray[np.float64]:
    points = np.zeros((count, 3))
    done = 0
    try:
        for piece in file.chunk_iterator(_PIECE):
            n = min(len(piece), count - done)
            for axis, name in enumerate("xyz"):
                points[done : done + n, axis] = np.asarray(piece[name])[:n]
            done += n
    except BaseException as error:
        # lazrs panics on some damaged files, which is no Exception; interrupts have to pass.
        if isinstance(error, KeyboardInterrupt | SystemExit | MemoryError):
            raise
        if packed:
            raise FileTruncated(
                f"The compressed points end or break after {done} of {count}: {error!s:.120}."
            ) from error
        raise
    if done < count:
        raise FileTruncated(f"The header promises {count} points; the file holds {done}.")
    return points


def _statement(header: Any) -> Statement:
    """Return z up, and the unit of the file's coordinate system if it has one."""
    usual = "z is up in LAS files."
    for record in [*header.vlrs, *(header.evlrs or [])]:
        text = getattr(record, "string", "")
        units = _WKT_UNIT.findall(text) if isinstance(text, str) else []
        lengths = [float(value) for name, value in units if "deg" not in name.lower() and float(value) > 0.1]
        if lengths and text.lstrip().startswith(("PROJ", "COMPD")):
            return Statement(
                "z", lengths[0], f"{usual} Its coordinate system counts units of {lengths[0]:.4g} m."
            )
        for key in getattr(record, "geo_keys", []):
            if getattr(key, "id", 0) == _PROJECTED_UNIT_KEY and key.value_offset in _GEO_UNITS:
                unit = _GEO_UNITS[key.value_offset]
                return Statement("z", unit, f"{usual} Its GeoTIFF keys count units of {unit:.4g} m.")
    return Statement("z", None, usual)
