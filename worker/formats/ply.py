"""Polygon files (PLY): the vertices, from text and from both binary byte orders.

The header is compared with the file's size before anything is allocated.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from service.domain.bounds import Bounds
from service.domain.errors import (
    FileEmpty,
    FileMalformed,
    FileTruncated,
    HeaderMismatch,
    TooManyPoints,
)
from worker.formats.ply_body import read_columns
from worker.formats.ply_header import PlyElement, PlyHeader, read_ply_header
from worker.formats.scan_checks import check_places
from worker.geometry.cloud.point_cloud import PointCloud


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
    read = _read_text if header.encoding == "ascii" else _read_binary
    points = read(path, header, vertex)
    if len(points) != vertex.count:
        raise FileTruncated(f"The header promises {vertex.count} vertices; the file holds {len(points)}.")
    check_places(points)
    return PointCloud.of(points)


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
    first_list = next((i for i, p in enumerate(vertex.properties) if p.is_list), len(names))
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


def _read_binary(path: Path, header: PlyHeader, vertex: PlyElement) -> NDArray[np.float64]:
    """Return x, y, z of a binary body."""
    columns = read_columns(path, header, vertex, ("x", "y", "z"))
    if any(column.lengths is not None for column in columns):
        raise FileMalformed("x, y or z of the PLY file is a list; each is one number.")
    return np.stack([column.values.astype(np.float64) for column in columns], axis=1)
