"""The faces of a PLY file, where its vertices are corners of a mesh and not points of a cloud."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyParseError

from service.domain.bounds import Bounds
from service.domain.errors import FileMalformed, FileTruncated
from worker.formats.mesh import fan
from worker.formats.ply import PlyElement, PlyHeader, read_ply, read_ply_header
from worker.formats.scan_checks import mesh_of
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.scan.file_scan import FileScan

_LISTS = ("vertex_indices", "vertex_index")
_FEWEST_FACES = 4
_MESHED_SHARE = 0.9
_SLOW_FACES = 2_000_000


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
    return any(p.name in _LISTS and p.length_bytes for p in faces.properties)


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
    """Return the triangles of a binary body: at once if all faces are triangles, else one by one."""
    fast = _all_triangles(path, header, faces)
    if fast is not None:
        return fast
    if faces.count > _SLOW_FACES:
        raise FileMalformed(
            f"The PLY file has {faces.count} faces that are not all triangles: triangulate it first."
        )
    try:
        with path.open("rb") as file:
            face: Any = PlyData.read(file)["face"]
            name = next(p.name for p in face.properties if p.name in _LISTS)
            lists = [np.asarray(row, dtype=np.int64) for row in face[name]]
    except (PlyParseError, ValueError, TypeError, MemoryError) as error:
        raise FileMalformed(
            "The faces of the PLY file cannot be read as its header describes them."
        ) from error
    return fan(np.array([len(row) for row in lists]), np.concatenate(lists))


def _all_triangles(path: Path, header: PlyHeader, faces: PlyElement) -> NDArray[np.int64] | None:
    """Return the triangles if every face is one and all before them has a fixed size; else None."""
    earlier = header.elements[: header.elements.index(faces)]
    if any(p.length_bytes for e in earlier for p in e.properties):
        return None
    fields: list[tuple[str, str] | tuple[str, str, int]] = []
    where = ""
    for number, p in enumerate(faces.properties):
        if p.name in _LISTS and p.length_bytes and not where:
            where = f"v{number}"
            fields += [(f"n{number}", _code(header, p.length_type)), (where, _code(header, p.value_type), 3)]
        elif p.length_bytes:
            return None
        else:
            fields.append((f"p{number}", _code(header, p.value_type)))
    record = np.dtype(fields)
    offset = header.data_offset + sum(e.least_bytes(text=False) for e in earlier)
    if path.stat().st_size < offset + faces.count * record.itemsize:
        return None
    with path.open("rb") as file:
        file.seek(offset)
        table = np.frombuffer(file.read(faces.count * record.itemsize), dtype=record)
    if not (table[f"n{where[1:]}"] == 3).all():
        return None
    return table[where].astype(np.int64)


def _code(header: PlyHeader, name: str) -> str:
    codes = {
        "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
        "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
        "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
    }  # fmt: skip
    return header.encoding + codes[name]
