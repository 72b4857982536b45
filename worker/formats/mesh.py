"""Meshes of scanning apps as OBJ and STL."""

from __future__ import annotations

import struct
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
from worker.formats.scan_checks import check_count, cloud_of, mesh_of
from worker.geometry.scan.file_scan import FileScan

_STL_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_MOST_CORNERS = 64


def load_obj(path: Path, *, bounds: Bounds) -> FileScan:
    """Return the triangles of a Wavefront OBJ file, or its vertices where it has no face.

    Materials, textures and lines are passed over; nothing that the file names is opened.

    Raises
    ------
    FileEmpty
        If there is no vertex, or the faces have no area.
    FileTruncated
        If the last line is cut, or faces point at vertices behind the end.
    FileMalformed
        If a vertex is no three numbers or a face is none.
    TooManyPoints, NotFinite
        As for every scan.
    """
    vertices: list[bytes] = []
    faces: list[list[int]] = []
    last = b""
    with path.open("rb") as file:
        for line in file:
            last = line
            if line.startswith((b"v ", b"v\t")):
                vertices.append(line[2:])
                if len(vertices) > bounds.max_points:
                    check_count(len(vertices), bounds=bounds, what="vertices")
            elif line.startswith((b"f ", b"f\t")):
                faces.append(_obj_face(line, len(vertices)))
                if len(faces) > 2 * bounds.max_points:
                    check_count(len(faces), bounds=bounds, what="faces")
    check_count(len(vertices), bounds=bounds, what="vertices")
    cut = not last.endswith(b"\n")
    points = _obj_vertices(vertices, cut=cut and last.startswith(b"v"))
    if not faces:
        return FileScan(cloud_of(points), "OBJ")
    triangles = fan(np.array([len(f) for f in faces]), np.concatenate([np.array(f) for f in faces]))
    if triangles.size and triangles.max() >= len(points):
        raise FileTruncated(
            f"A face points at vertex {int(triangles.max()) + 1}; the file holds {len(points)} vertices."
        )
    return FileScan(mesh_of(points, triangles, bounds=bounds), "OBJ")


def _obj_face(line: bytes, seen: int) -> list[int]:
    """Return the vertices of a face, counted from 0; negative numbers count back from the last one seen."""
    words = line.split()[1:]
    if not 3 <= len(words) <= _MOST_CORNERS:
        raise FileMalformed(f"A face of the OBJ file has {len(words)} corners: {line[:60]!r}.")
    try:
        numbers = [int(word.split(b"/", 1)[0]) for word in words]
    except ValueError:
        raise FileMalformed(f"A face of the OBJ file is not understood: {line[:60]!r}.") from None
    if 0 in numbers:
        raise FileMalformed("A face of the OBJ file points at vertex 0; they are counted from 1.")
    return [number - 1 if number > 0 else seen + number for number in numbers]


def _obj_vertices(lines: list[bytes], *, cut: bool) -> NDArray[np.float64]:
    try:
        return np.array([line.split(None, 3)[:3] for line in lines], dtype=np.float64).reshape(-1, 3)
    except ValueError as error:
        if cut:
            raise FileTruncated("The OBJ file ends inside a vertex.") from error
        raise FileMalformed("A vertex of the OBJ file is no row of three numbers.") from error


def fan(counts: NDArray[np.integer], corners: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return the triangles of polygons, each split from its first corner.

    Parameters
    ----------
    counts : ndarray of shape (P,), int
        How many corners each polygon has; those with fewer than three give nothing.
    corners : ndarray of shape (sum of counts,), int
        The polygons' vertices, one polygon after the other.

    Returns
    -------
    ndarray of shape (F, 3), int64
        The triangles' vertices, in the order of the polygons.

    Raises
    ------
    FileMalformed
        If the counts do not sum up to the number of corners.

    Examples
    --------
    >>> fan(np.array([4, 3]), np.array([0, 1, 2, 3, 7, 8, 9])).tolist()
    [[0, 1, 2], [0, 2, 3], [7, 8, 9]]
    """
    counts = np.asarray(counts, dtype=np.int64)
    if (counts < 0).any() or int(counts.sum()) != len(corners):
        raise FileMalformed(
            f"The faces have {int(counts.sum())} corners by their counts, and {len(corners)} given."
        )
    starts = np.cumsum(counts) - counts
    per_face = np.maximum(counts - 2, 0)
    first = np.repeat(starts, per_face)
    step = np.arange(len(first)) - np.repeat(np.cumsum(per_face) - per_face, per_face)
    return np.stack([corners[first], corners[first + step + 1], corners[first + step + 2]], axis=1).astype(
        np.int64
    )


def load_stl(path: Path, *, bounds: Bounds) -> FileScan:
    """Return the triangles of an STL file, binary or text.

    Raises
    ------
    FileEmpty
        If there is no triangle, or none has an area.
    FileTruncated
        If the bytes end before the header's number of triangles, or the text inside a triangle.
    HeaderMismatch
        If more bytes follow than the header's number of triangles need.
    FileMalformed
        If a vertex of the text is no three numbers.
    TooManyPoints, NotFinite
        As for every scan.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(84)
        (count,) = struct.unpack("<I", head[80:84]) if len(head) == 84 else (0,)
        exact = size == 84 + count * _STL_RECORD.itemsize
        if head.lstrip().startswith(b"solid") and not exact:
            return _text_stl(path, bounds=bounds)
        if len(head) < 84:
            raise FileTruncated(f"An STL file has a header of 84 bytes; this one has {size} bytes in all.")
        check_count(count, bounds=bounds, what="triangles")
        if not exact:
            needed = 84 + count * _STL_RECORD.itemsize
            leaf = FileTruncated if size < needed else HeaderMismatch
            raise leaf(
                f"The header promises {count} triangles, which need {needed} bytes; the file has {size}."
            )
        record = np.frombuffer(file.read(), dtype=_STL_RECORD)
    corners = record["corners"].reshape(-1, 3).astype(np.float64)
    return FileScan(mesh_of(corners, np.arange(len(corners)).reshape(-1, 3), bounds=bounds), "STL")


def _text_stl(path: Path, *, bounds: Bounds) -> FileScan:
    """Return the triangles of an STL file of text."""
    rows: list[list[bytes]] = []
    whole = False
    with path.open("rb") as file:
        for line in file:
            words = line.split()
            if words[:1] == [b"vertex"]:
                rows.append(words[1:4])
                if len(rows) > 3 * bounds.max_points:
                    raise TooManyPoints(f"The STL file has more than {bounds.max_points} triangles.")
            whole = words[:1] == [b"endsolid"] or (whole and not words)
    if len(rows) % 3 or not whole:
        raise FileTruncated("The text of the STL file ends before its line 'endsolid'.")
    if not rows:
        raise FileEmpty("The STL file holds no triangle.")
    try:
        corners = np.array(rows, dtype=np.float64).reshape(-1, 3)
    except ValueError as error:
        raise FileMalformed("A vertex of the STL file is no row of three numbers.") from error
    return FileScan(mesh_of(corners, np.arange(len(corners)).reshape(-1, 3), bounds=bounds), "STL")
