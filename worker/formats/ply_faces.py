"""The faces of a PLY file, where its vertices are corners of a mesh and not points of a cloud."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from service.domain.bounds import Bounds
from service.domain.errors import FileMalformed, FileTruncated
from worker.formats.mesh import fan
from worker.formats.ply import read_ply
from worker.formats.ply_body import read_columns
from worker.formats.ply_header import PlyElement, PlyHeader, read_ply_header
from worker.formats.scan_checks import mesh_of
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.scan.file_scan import FileScan

_LISTS = ("vertex_indices", "vertex_index")
_FEWEST_FACES = 4
_MESHED_SHARE = 0.9


def load_ply(path: Path, *, bounds: Bounds) -> FileScan:
    """Return a PLY file's triangles if nine in ten of its vertices are corners of faces, else its vertices.

    Raises
    ------
    FileTruncated
        If the bytes end before the header's number of elements.
    FileMalformed
        If a face points at a vertex that is not there.
    Rejected
        Else as `read_ply` does.
    """
    cloud = read_ply(path, bounds)
    header = read_ply_header(path)
    faces = next((e for e in header.elements if e.name == "face"), None)
    if faces is None or faces.count < _FEWEST_FACES or not _has_list(faces):
        return FileScan(cloud, "PLY")
    triangles = _text(path, header, faces) if header.encoding == "ascii" else _binary(path, header, faces)
    if not len(triangles) or not _is_mesh(cloud, triangles):
        return FileScan(cloud, "PLY")
    return FileScan(mesh_of(cloud.points, triangles, bounds=bounds), "PLY")


def _has_list(faces: PlyElement) -> bool:
    return any(p.name in _LISTS and p.is_list for p in faces.properties)


def _is_mesh(cloud: PointCloud, triangles: NDArray[np.int64]) -> bool:
    if triangles.min() < 0 or triangles.max() >= len(cloud):
        raise FileMalformed(f"A face of the PLY file points outside its {len(cloud)} vertices.")
    corner = np.zeros(len(cloud), dtype=np.bool_)
    corner[triangles.ravel()] = True
    return bool(corner.mean() >= _MESHED_SHARE)


def _text(path: Path, header: PlyHeader, faces: PlyElement) -> NDArray[np.int64]:
    """Return the triangles of a body of text; the list has to come first in a face's line."""
    if faces.properties[0].name not in _LISTS:
        return np.zeros((0, 3), dtype=np.int64)
    before = sum(e.count for e in header.elements[: header.elements.index(faces)])
    with path.open("rb") as file:
        file.seek(header.data_offset)
        lines = file.read().split(b"\n")
    rows = [line for line in lines if line.strip()][before : before + faces.count]
    if len(rows) < faces.count:
        raise FileTruncated(f"The header promises {faces.count} faces; the file holds {len(rows)}.")
    try:
        return _equal_rows(rows)
    except ValueError as error:
        raise FileMalformed("A face of the PLY file is no list of vertices.") from error


def _equal_rows(rows: list[bytes]) -> NDArray[np.int64]:
    lengths = np.array([int(row.split(None, 1)[0]) for row in rows])
    if (lengths == 3).all():
        table = np.loadtxt(io.BytesIO(b"\n".join(rows)), usecols=(1, 2, 3), ndmin=2, dtype=np.float64)
        return table.astype(np.int64)
    corners = [[int(word) for word in row.split()[1 : 1 + n]] for row, n in zip(rows, lengths, strict=True)]
    return fan(lengths, np.array([c for face in corners for c in face], dtype=np.int64))


def _binary(path: Path, header: PlyHeader, faces: PlyElement) -> NDArray[np.int64]:
    """Return the triangles of a binary body."""
    name = next(p.name for p in faces.properties if p.name in _LISTS and p.is_list)
    (corners,) = read_columns(path, header, faces, (name,))
    if corners.lengths is None or corners.values.dtype.kind == "f":
        raise FileMalformed(f"The faces of the PLY file name their corners by {corners.values.dtype.name}.")
    return fan(corners.lengths, corners.values.astype(np.int64))
