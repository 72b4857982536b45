"""Point cloud files of PCL (PCD v0.7): read in all three encodings, written in one.

The header is compared with the bytes that the file really has before anything is allocated, so a
header that lies costs nothing.
"""

from __future__ import annotations

import io
import struct
from dataclasses import dataclass
from pathlib import Path

import lzf
import numpy as np
from numpy.typing import NDArray

from service.domain.bounds import Bounds
from service.domain.errors import (
    FileEmpty,
    FileMalformed,
    FileTruncated,
    HeaderMismatch,
    TooManyPoints,
    UnsupportedMedia,
)
from worker.formats.scan_checks import check_places
from worker.geometry.cloud.point_cloud import PointCloud

_MAX_HEADER_BYTES = 16_384
_MAX_LZF_RATIO = 132  # one LZF back reference of 3 bytes gives at most 264 bytes; literals give less
_MAX_RECORD_BYTES = 4_096
_KNOWN = ("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA")
_NUMPY = {
    **{("F", n): f"<f{n}" for n in (4, 8)},
    **{("U", n): f"<u{n}" for n in (1, 2, 4, 8)},
    **{("I", n): f"<i{n}" for n in (1, 2, 4, 8)},
}
_RECORD = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("label", "<u4")])


@dataclass(frozen=True)
class _Header:
    """Hold what the text at the top of the file promises."""

    names: tuple[str, ...]
    dtype: np.dtype[np.void]
    columns: int
    points: int
    organised: bool
    encoding: str
    data_offset: int


def write_pcd(path: Path, cloud: PointCloud) -> None:
    """Write a cloud as `pcd_bytes` says.

    Parameters
    ----------
    path : Path
        File to write; an existing one is replaced.
    """
    Path(path).write_bytes(pcd_bytes(cloud))


def pcd_bytes(cloud: PointCloud) -> bytes:
    """Return a cloud as PCD v0.7, ``DATA binary``, with the fields of PCL's ``PointXYZL``.

    The same cloud gives the same bytes on every machine: nothing but the points and labels, in
    their order, goes into the file. Coordinates are rounded to float32 [m].

    Parameters
    ----------
    cloud : PointCloud
        N points, N may be 0.
    """
    n = len(cloud)
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z label\nSIZE 4 4 4 4\n"
        f"TYPE F F F U\nCOUNT 1 1 1 1\nWIDTH {n}\nHEIGHT 1\n"
        f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA binary\n"
    )
    record = np.zeros(n, dtype=_RECORD)
    for axis, name in enumerate("xyz"):
        record[name] = cloud.points[:, axis]
    record["label"] = cloud.labels
    return header.encode("ascii") + record.tobytes()


def read_pcd(path: Path, bounds: Bounds = Bounds()) -> PointCloud:  # noqa: B008 - a frozen value
    """Return the points of a PCD file [its own units], with its ``label`` field where it has one.

    Points of an *organised* cloud (``HEIGHT`` above 1) that are NaN mean "no return" by PCL's
    convention and are left out; in any other cloud a coordinate that is not finite refuses the file.

    Parameters
    ----------
    path : Path
        File in the encoding ``ascii``, ``binary`` or ``binary_compressed``.
    bounds : Bounds
        The most points to read.

    Returns
    -------
    PointCloud
        N >= 1 points in the file's own order and frame.

    Raises
    ------
    FileEmpty
        If the file has no bytes, or no point.
    FileTruncated
        If the bytes end before the header's number of points.
    HeaderMismatch
        If the header contradicts itself or the bytes.
    FileMalformed
        If the header or the body breaks the format.
    TooManyPoints
        If the header promises more than `bounds` allows; nothing has been allocated then.
    NotFinite, CoordinatesTooLarge
        If a coordinate is infinite, or NaN in an unorganised cloud.
    UnsupportedMedia
        If the file is no PCD.

    Notes
    -----
    Format: https://pointclouds.org/documentation/tutorials/pcd_file_format.html. Compressed bodies
    are LZF blocks, one field after the other.
    """
    path = Path(path)
    size = path.stat().st_size
    if size == 0:
        raise FileEmpty("The point cloud file has no bytes.")
    with path.open("rb") as file:
        header = _read_header(file.read(_MAX_HEADER_BYTES))
        _check_count(header, size=size, bounds=bounds)
        file.seek(header.data_offset)
        if header.encoding == "ascii":
            columns = _read_ascii(file.read(), header)
        elif header.encoding == "binary":
            columns = _read_binary(file.read(header.points * header.dtype.itemsize), header)
        else:
            columns = _read_compressed(file.read(), header)
    return _to_cloud(columns, header)


def _read_header(head: bytes) -> _Header:
    """Return the header parsed from the first bytes of the file."""
    if not head.lstrip().startswith((b"# .PCD", b"VERSION", b"FIELDS", b"#")):
        raise UnsupportedMedia("The file does not begin as a PCD does ('# .PCD' or 'VERSION').")
    entries: dict[str, list[str]] = {}
    offset = 0
    while "DATA" not in entries:
        end = head.find(b"\n", offset)
        if end < 0:
            if len(head) < _MAX_HEADER_BYTES:
                raise FileTruncated("The PCD file ends inside its header: no DATA line was found.")
            raise FileMalformed(f"No DATA line within the first {_MAX_HEADER_BYTES} bytes of the PCD file.")
        words = head[offset:end].decode("ascii", errors="replace").split()
        offset = end + 1
        if words and words[0].upper() in _KNOWN:
            entries.setdefault(words[0].upper(), words[1:])
    return _interpret(entries, offset)


def _numbers(entries: dict[str, list[str]], key: str, *, least: int) -> list[int]:
    """Return an entry's integers."""
    try:
        values = [int(word) for word in entries[key]]
    except KeyError:
        raise FileMalformed(f"The PCD header has no {key} line.") from None
    except ValueError:
        raise FileMalformed(f"The PCD header's {key} line holds more than whole numbers.") from None
    if not values or min(values) < least:
        raise FileMalformed(f"The PCD header's {key} line is empty or holds a number below {least}.")
    return values


def _interpret(entries: dict[str, list[str]], data_offset: int) -> _Header:
    """Return the header's meaning; refuse what contradicts itself."""
    names = tuple(word.lower() for word in entries.get("FIELDS", entries.get("COLUMNS", [])))
    sizes, types = _numbers(entries, "SIZE", least=1), entries.get("TYPE", [])
    counts = _numbers(entries, "COUNT", least=1) if "COUNT" in entries else [1] * len(names)
    if not (len(names) == len(sizes) == len(types) == len(counts)):
        raise HeaderMismatch("The PCD header's FIELDS, SIZE, TYPE and COUNT lines differ in length.")
    if not {"x", "y", "z"} <= set(names):
        raise FileMalformed(f"A point cloud needs the fields x, y and z; this file has {' '.join(names)}.")
    parts = []
    record_bytes = sum(size * count for size, count in zip(sizes, counts, strict=True))
    if record_bytes > _MAX_RECORD_BYTES:
        raise FileMalformed(f"A point of {record_bytes} bytes is above the {_MAX_RECORD_BYTES} read.")
    for i, (size, kind, count) in enumerate(zip(sizes, types, counts, strict=True)):
        code = _NUMPY.get((kind.upper(), size))
        if code is None:
            raise FileMalformed(f"PCD knows no field of type {kind} with {size} bytes.")
        parts.append((f"f{i}", code, (count,)))
    width, height = _numbers(entries, "WIDTH", least=0)[0], _numbers(entries, "HEIGHT", least=0)[0]
    points = _numbers(entries, "POINTS", least=0)[0] if "POINTS" in entries else width * height
    if points != width * height:
        raise HeaderMismatch(f"The PCD header says {points} points, but {width} columns by {height} rows.")
    encoding = " ".join(entries["DATA"]).lower()
    if encoding not in {"ascii", "binary", "binary_compressed"}:
        raise FileMalformed(f"PCD knows no encoding {encoding!r}.")
    return _Header(names, np.dtype(parts), sum(counts), points, height > 1, encoding, data_offset)


def _check_count(header: _Header, *, size: int, bounds: Bounds) -> None:
    """Refuse a number of points that the file cannot hold, before anything is allocated for it."""
    if header.points == 0:
        raise FileEmpty("The point cloud file holds no point.")
    if header.points > bounds.max_points:
        raise TooManyPoints(
            f"The header promises {header.points} points; at most {bounds.max_points} are read.",
            max_points=bounds.max_points,
        )
    body = size - header.data_offset
    least = header.points * header.dtype.itemsize
    if header.encoding == "ascii":
        least = 2 * header.points * header.columns - 1
    elif header.encoding == "binary_compressed":
        least = 8 + least // _MAX_LZF_RATIO
    if body < least:
        raise FileTruncated(
            f"The header promises {header.points} points, which need {least} bytes or more;"
            f" {max(body, 0)} follow it."
        )


def _read_binary(body: bytes, header: _Header) -> dict[str, NDArray[np.generic]]:
    """Return x, y, z and label of a body of records."""
    record = np.frombuffer(body, dtype=header.dtype)
    if len(record) != header.points:
        raise FileTruncated(f"The header promises {header.points} points; the file holds {len(record)}.")
    return {name: record[f"f{i}"][:, 0] for i, name in _wanted(header)}


def _read_compressed(body: bytes, header: _Header) -> dict[str, NDArray[np.generic]]:
    """Return x, y, z and label of an LZF body, in which field follows field."""
    packed, unpacked = struct.unpack("<II", body[:8])
    expected = header.points * header.dtype.itemsize
    if unpacked != expected:
        raise HeaderMismatch(
            f"The compressed body says it unpacks to {unpacked} bytes;"
            f" {header.points} points need {expected}."
        )
    if len(body) - 8 < packed:
        raise FileTruncated(f"The compressed body says {packed} bytes; {len(body) - 8} follow.")
    try:
        plain = lzf.decompress(body[8 : 8 + packed], unpacked)
    except ValueError as error:
        raise FileMalformed("The compressed body of the PCD file cannot be unpacked.") from error
    if plain is None or len(plain) != expected:
        raise FileMalformed("The compressed body of the PCD file unpacks to a wrong number of bytes.")
    columns: dict[str, NDArray[np.generic]] = {}
    offset, wanted = 0, dict(_wanted(header))
    for i in range(len(header.names)):
        field = header.dtype[f"f{i}"]
        if i in wanted:
            count = header.points * (field.itemsize // field.base.itemsize)
            column = np.frombuffer(plain, dtype=field.base, count=count, offset=offset)
            columns[wanted[i]] = column.reshape(header.points, -1)[:, 0]
        offset += field.itemsize * header.points
    return columns


def _read_ascii(body: bytes, header: _Header) -> dict[str, NDArray[np.generic]]:
    """Return x, y, z and label of a body of text, a point a line."""
    starts = np.cumsum([0] + [header.dtype[i].itemsize // header.dtype[i].base.itemsize
                              for i in range(len(header.names))])  # fmt: skip
    wanted = _wanted(header)
    try:
        table = np.loadtxt(
            io.BytesIO(body), usecols=[int(starts[i]) for i, _ in wanted], ndmin=2,
            max_rows=header.points, dtype=np.float64, comments="#",
        )  # fmt: skip
    except ValueError as error:
        raise FileMalformed(f"The text body of the PCD file is no table of numbers: {error}.") from error
    if len(table) != header.points:
        raise FileTruncated(f"The header promises {header.points} points; the file holds {len(table)}.")
    return {name: table[:, k] for k, (_, name) in enumerate(wanted)}


def _wanted(header: _Header) -> list[tuple[int, str]]:
    """Return index and name of the fields that are kept, the first of each name."""
    return [(header.names.index(name), name) for name in ("x", "y", "z", "label") if name in header.names]


def _to_cloud(columns: dict[str, NDArray[np.generic]], header: _Header) -> PointCloud:
    """Return the columns as a cloud; drop an organised cloud's empty pixels, refuse other non-numbers."""
    points = np.stack([columns[name].astype(np.float64) for name in "xyz"], axis=1)
    raw = columns.get("label")
    labels = np.zeros(len(points)) if raw is None else raw.astype(np.float64)
    if header.organised:
        seen = ~np.isnan(points).any(axis=1)
        points, labels = points[seen], labels[seen]
        if not len(points):
            raise FileEmpty("Every point of the organised cloud is marked as not seen (NaN).")
    check_places(points)
    if not (np.isfinite(labels).all() and (labels >= 0).all() and (labels < 2**32).all()):
        raise FileMalformed("The label field holds values that are not whole numbers from 0 to 2^32 - 1.")
    return PointCloud(points, labels.astype(np.uint32))
