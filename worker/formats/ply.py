"""Polygon files (PLY): the vertices, from text and from both binary byte orders.

The header is compared with the file's size before anything is allocated. Text is read by numpy, which is
thirty times as fast as plyfile there; binary by plyfile, which refuses what ends early.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyParseError

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

_MAX_HEADER_BYTES = 65_536
_BYTES = {
    "char": 1, "int8": 1, "uchar": 1, "uint8": 1, "short": 2, "int16": 2, "ushort": 2, "uint16": 2,
    "int": 4, "int32": 4, "uint": 4, "uint32": 4, "float": 4, "float32": 4, "double": 8, "float64": 8,
}  # fmt: skip
_FORMATS = {"ascii": "ascii", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True)
class PlyProperty:
    """Hold one property: its name, the bytes of its value, and of its length if it is a list."""

    name: str
    value_bytes: int
    length_bytes: int
    value_type: str = ""
    length_type: str = ""


@dataclass(frozen=True)
class PlyElement:
    """Hold one element of the header: its name, how many, and its properties."""

    name: str
    count: int
    properties: tuple[PlyProperty, ...]

    def least_bytes(self, *, text: bool) -> int:
        """Return the fewest bytes that the body needs for this element."""
        if text:
            return 2 * self.count * len(self.properties)
        return self.count * sum(p.length_bytes or p.value_bytes for p in self.properties)


@dataclass(frozen=True)
class PlyHeader:
    """Hold what the text at the top of the file promises."""

    encoding: str
    elements: tuple[PlyElement, ...]
    data_offset: int


def read_ply(path: Path, bounds: Bounds | None = None) -> PointCloud:
    """Return the vertices of a PLY file, in the file's own units and axes, without label.

    Faces, colours and list properties are passed over.

    Parameters
    ----------
    path : Path
        File in the format ``ascii``, ``binary_little_endian`` or ``binary_big_endian``, version 1.0.
    bounds : Bounds, optional
        The most points to read.

    Returns
    -------
    PointCloud
        N >= 1 points in the file's order.

    Raises
    ------
    FileEmpty
        If the file has no bytes, or no vertex.
    FileTruncated
        If the bytes end before the header's number of elements.
    HeaderMismatch
        If the text holds something else than the header promises.
    FileMalformed
        If the header or the body breaks the format, or x, y, z are missing.
    TooManyPoints
        If the header promises more than `bounds` allows; nothing has been allocated then.
    NotFinite, CoordinatesTooLarge
        If a coordinate is NaN or infinite.
    UnsupportedMedia
        If the file is no PLY.
    """
    path, bounds = Path(path), bounds or Bounds()
    size = path.stat().st_size
    if size == 0:
        raise FileEmpty("The PLY file has no bytes.")
    header = read_ply_header(path)
    vertex = _check(header, size=size, bounds=bounds)
    points = _read_text(path, header, vertex) if header.encoding == "ascii" else _read_binary(path)
    if len(points) != vertex.count:
        raise FileTruncated(f"The header promises {vertex.count} vertices; the file holds {len(points)}.")
    check_places(points)
    return PointCloud.of(points)


def read_ply_header(path: Path) -> PlyHeader:
    """Return what a PLY file's header promises; nothing of it has been compared with the bytes yet.

    Raises
    ------
    FileTruncated, FileMalformed, UnsupportedMedia
        As `read_ply` does.
    """
    with path.open("rb") as file:
        return _read_header(file.read(_MAX_HEADER_BYTES))


def _read_header(head: bytes) -> PlyHeader:
    """Return the header parsed from the first bytes of the file."""
    if not head.startswith((b"ply\n", b"ply\r")):
        raise UnsupportedMedia("The file does not begin with the line 'ply'.")
    end = head.find(b"end_header")
    stop = head.find(b"\n", end)
    if end < 0 or stop < 0:
        if len(head) < _MAX_HEADER_BYTES:
            raise FileTruncated("The PLY file ends inside its header: no end_header line was found.")
        raise FileMalformed(f"No end_header within the first {_MAX_HEADER_BYTES} bytes of the PLY file.")
    encoding, elements = "", []
    properties: list[PlyProperty] = []
    for line in head[:end].decode("ascii", errors="replace").splitlines()[1:]:
        words = line.split()
        if not words or words[0] in {"comment", "obj_info"}:
            continue
        if words[0] == "format" and len(words) == 3 and words[1] in _FORMATS:
            encoding = _FORMATS[words[1]]
        elif words[0] == "element" and len(words) == 3 and words[2].isdigit():
            properties = []
            elements.append((words[1], int(words[2]), properties))
        elif words[0] == "property" and elements:
            properties.append(_property(words))
        else:
            raise FileMalformed(f"The PLY header holds a line that the format does not know: {line[:80]!r}.")
    if not encoding:
        raise FileMalformed("The PLY header names no format.")
    return PlyHeader(encoding, tuple(PlyElement(n, c, tuple(p)) for n, c, p in elements), stop + 1)


def _property(words: list[str]) -> PlyProperty:
    """Return one property line's meaning."""
    types = words[2:4] if len(words) == 5 and words[1] == "list" else words[1:2]
    if len(words) not in {3, 5} or any(name not in _BYTES for name in types):
        raise FileMalformed(
            f"The PLY header holds a property that is not understood: {' '.join(words)[:80]!r}."
        )
    length = _BYTES[types[0]] if len(types) == 2 else 0
    return PlyProperty(words[-1], _BYTES[types[-1]], length, types[-1], types[0] if length else "")


def _check(header: PlyHeader, *, size: int, bounds: Bounds) -> PlyElement:
    """Return the vertices' element; refuse numbers that the file cannot hold, before allocating."""
    vertex = next((e for e in header.elements if e.name == "vertex"), None)
    if vertex is None or vertex.count == 0:
        raise FileEmpty("The PLY file holds no vertex.")
    names = [p.name for p in vertex.properties]
    if not {"x", "y", "z"} <= set(names) or len(set(names)) != len(names):
        raise FileMalformed(f"A vertex needs x, y and z, each once; this file has {' '.join(names)}.")
    most = max(e.count for e in header.elements)
    if vertex.count > bounds.max_points or most > 4 * bounds.max_points:
        raise TooManyPoints(
            f"The header promises {most} elements; at most {bounds.max_points} points are read.",
            max_points=bounds.max_points,
        )
    least = sum(e.least_bytes(text=header.encoding == "ascii") for e in header.elements)
    if size - header.data_offset < least - 1:
        raise FileTruncated(
            f"The header promises elements that need {least} bytes or more;"
            f" {max(size - header.data_offset, 0)} follow it."
        )
    return vertex


def _read_text(path: Path, header: PlyHeader, vertex: PlyElement) -> NDArray[np.float64]:
    """Return x, y, z of a body of text; elements before the vertices take a line each."""
    before = 0
    for element in header.elements:
        if element is vertex:
            break
        before += element.count
    names = [p.name for p in vertex.properties]
    first_list = next((i for i, p in enumerate(vertex.properties) if p.length_bytes), len(names))
    columns = [names.index(axis) for axis in "xyz"]
    if max(columns) > first_list:
        raise FileMalformed("x, y and z stand behind a list property, which text files cannot be read with.")
    with path.open("rb") as file:
        file.seek(header.data_offset)
        body = file.read()
    try:
        table = np.loadtxt(
            io.BytesIO(body), usecols=columns, ndmin=2, skiprows=before, max_rows=vertex.count, comments=None
        )
    except ValueError as error:
        if not body.endswith((b"\n", b"\r")):
            raise FileTruncated("The text of the PLY file ends inside a line: it is cut short.") from error
        raise HeaderMismatch(f"The text of the PLY file is not what its header promises: {error}.") from error
    return table.reshape(-1, 3)


def _read_binary(path: Path) -> NDArray[np.float64]:
    """Return x, y, z of a binary body."""
    try:
        with path.open("rb") as file:
            vertex = PlyData.read(file)["vertex"]
            return np.stack([np.asarray(vertex[axis], dtype=np.float64) for axis in "xyz"], axis=1)
    except PlyParseError as error:
        if "early end-of-file" in str(error):
            raise FileTruncated(f"The PLY file ends before its header says: {error}.") from error
        raise FileMalformed(f"The PLY file breaks its format: {error}.") from error
    except (ValueError, TypeError, MemoryError, UnicodeDecodeError) as error:
        raise FileMalformed("The PLY file's elements cannot be read as its header describes them.") from error
