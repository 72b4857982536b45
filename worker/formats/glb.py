"""Binary glTF (GLB): the triangles or points of its scene, without materials, from the one file alone."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.domain.bounds import Bounds
from service.domain.errors import FileEmpty, FileMalformed, FileTruncated, HeaderMismatch
from worker.formats.scan_checks import check_count, cloud_of, mesh_of
from worker.geometry.scan.file_scan import FileScan, Statement

_MOST_NODES = 100_000
_MOST_DEPTH = 256
_MOST_JSON = 64 << 20
_CODES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_STEPS = {5120: 127.0, 5121: 255.0, 5122: 32767.0, 5123: 65535.0}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_POINTS, _TRIANGLES, _STRIP, _FAN = 0, 4, 5, 6
_GLTF = Statement("y", 1.0, "glTF is in metres with y up, by its specification.")


@dataclass(frozen=True, eq=False)
class _Model:
    """Hold a file's description and the bytes that its tables lie in."""

    tree: dict[str, Any]
    body: bytes
    bounds: Bounds

    def table(self, number: int) -> NDArray[np.float64] | NDArray[np.int64]:
        """Return an accessor's values: (count, width), as int64 where they are whole and not normalized."""
        accessor = self.tree["accessors"][number]
        count, width = int(accessor["count"]), _WIDTHS[accessor["type"]]
        code = np.dtype(_CODES[accessor["componentType"]])
        if count > 6 * self.bounds.max_points:
            check_count(count, bounds=self.bounds, what="entries in one table")
        if "sparse" in accessor or "bufferView" not in accessor:
            raise FileMalformed("A table of the GLB file is sparse, which is not read: export a plain mesh.")
        view = self.tree["bufferViews"][accessor["bufferView"]]
        start = int(view.get("byteOffset", 0)) + int(accessor.get("byteOffset", 0))
        stride = int(view.get("byteStride", 0)) or width * code.itemsize
        end = start + (count - 1) * stride + width * code.itemsize
        if count < 0 or start < 0 or stride < width * code.itemsize or (count and end > len(self.body)):
            raise HeaderMismatch(
                f"A table of {count} entries ends at byte {end}; the GLB file has {len(self.body)} of tables."
            )
        raw = np.ndarray((count, width), code, self.body, start, (stride, code.itemsize)) if count else None
        values = np.zeros((0, width), code) if raw is None else raw
        if accessor.get("normalized") and accessor["componentType"] in _STEPS:
            return np.asarray(np.maximum(values / _STEPS[accessor["componentType"]], -1.0), dtype=np.float64)
        if code.kind == "f":
            return values.astype(np.float64)
        return values.astype(np.int64)


def load_glb(path: Path, *, bounds: Bounds) -> FileScan:
    """Return the triangles of a binary glTF file's scene, or its points where it has no triangle.

    Nodes are placed as the scene says. Materials, images, bones and morphs are passed over.

    Raises
    ------
    FileTruncated
        If the bytes end before the header's length.
    HeaderMismatch
        If a table needs more bytes than the file has.
    FileMalformed
        If the file breaks the format, keeps its mesh in another file, or compresses it (Draco, meshopt).
    FileEmpty, TooManyPoints, NotFinite
        As for every scan.

    Notes
    -----
    glTF 2.0, https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html, sections 3 and 4.
    """
    try:
        model = _open(path, bounds)
        meshes, clouds = _shapes(model)
    except (KeyError, TypeError, IndexError, ValueError, AttributeError, OverflowError) as error:
        raise FileMalformed(f"The GLB file's description breaks the format: {error!r:.150}.") from error
    if meshes:
        before = np.cumsum([0] + [len(vertices) for vertices, _ in meshes])
        triangles = [faces + shift for (_, faces), shift in zip(meshes, before[:-1], strict=True)]
        vertices = np.vstack([vertices for vertices, _ in meshes])
        return FileScan(mesh_of(vertices, np.vstack(triangles), bounds=bounds), "GLB", _GLTF)
    if not clouds:
        raise FileEmpty("The GLB file holds neither triangles nor points.")
    return FileScan(cloud_of(np.vstack(clouds)), "GLB", _GLTF)


def _open(path: Path, bounds: Bounds) -> _Model:
    """Return the description and the bytes, both chunks compared with the file's size first."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(20)
        if len(head) < 20:
            raise FileTruncated(f"A GLB file has a header of 20 bytes; this one has {size} bytes in all.")
        _, version, length, json_bytes, _ = struct.unpack("<4sIIII", head)
        if version != 2:
            raise FileMalformed(f"The GLB file is of version {version}; version 2 is read.")
        if size < (needed := max(length, 20 + json_bytes)):
            raise FileTruncated(f"The GLB header promises {needed} bytes; the file has {size}.")
        if json_bytes > _MOST_JSON:
            raise FileMalformed(
                f"The GLB file's description has {json_bytes} bytes, above the {_MOST_JSON} read."
            )
        try:
            tree = json.loads(file.read(json_bytes))
        except (ValueError, RecursionError) as error:
            raise FileMalformed("The GLB file's description is no JSON.") from error
        body_head = file.read(8)
        body = file.read(struct.unpack("<I", body_head[:4])[0]) if len(body_head) == 8 else b""
    packed = {"KHR_draco_mesh_compression", "EXT_meshopt_compression"} & set(
        tree.get("extensionsRequired", [])
    )
    if packed:
        raise FileMalformed(f"The mesh is compressed ({min(packed)}): export it without compression.")
    if any("uri" in buffer for buffer in tree.get("buffers", [])):
        raise FileMalformed("The GLB file keeps its mesh in another file: export it as one file.")
    return _Model(tree, body, bounds)


def _shapes(
    model: _Model,
) -> tuple[list[tuple[NDArray[np.float64], NDArray[np.int64]]], list[NDArray[np.float64]]]:
    """Return the meshes and the clouds of the scene, in its frame."""
    meshes: list[tuple[NDArray[np.float64], NDArray[np.int64]]] = []
    clouds: list[NDArray[np.float64]] = []
    seen = 0
    for matrix, mesh in _placed(model.tree):
        for primitive in model.tree["meshes"][mesh]["primitives"]:
            mode = primitive.get("mode", _TRIANGLES)
            if mode not in {_POINTS, _TRIANGLES, _STRIP, _FAN} or "POSITION" not in primitive["attributes"]:
                continue
            local = np.asarray(model.table(primitive["attributes"]["POSITION"]), dtype=np.float64)
            seen += len(local)
            check_count(max(seen, 1), bounds=model.bounds, what="vertices")
            with np.errstate(invalid="ignore", over="ignore"):
                points = local @ matrix[:3, :3].T + matrix[:3, 3]
            if mode == _POINTS:
                clouds.append(points)
                continue
            order = (
                model.table(primitive["indices"])[:, 0] if "indices" in primitive else np.arange(len(local))
            )
            faces = _faces(np.asarray(order, dtype=np.int64), mode)
            if faces.size and faces.max() >= len(local):
                raise FileMalformed(f"A face of the GLB file points outside its {len(local)} vertices.")
            meshes.append((points, faces))
    return meshes, clouds


def _faces(order: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """Return the (F, 3) triangles of a list, a strip or a fan of corners; their sides do not matter."""
    if mode == _TRIANGLES:
        return order[: len(order) // 3 * 3].reshape(-1, 3)
    first = order[:-2] if mode == _STRIP else np.repeat(order[:1], max(len(order) - 2, 0))
    return np.stack([first, order[1:-1], order[2:]], axis=1)


def _placed(tree: dict[str, Any]) -> list[tuple[NDArray[np.float64], int]]:
    """Return every mesh of the scene with the matrix that takes it there; all meshes if there is no scene."""
    nodes = tree.get("nodes", [])
    children = [int(child) for node in nodes for child in node.get("children", [])]
    if len(nodes) > _MOST_NODES or len(children) != len(set(children)):
        raise FileMalformed("The scene of the GLB file is no tree, or has too many nodes.")
    if not nodes:
        return [(np.eye(4), number) for number in range(len(tree.get("meshes", [])))]
    roots = tree["scenes"][tree.get("scene", 0)]["nodes"] if tree.get("scenes") else None
    if roots is None:
        roots = sorted(set(range(len(nodes))) - set(children))
    placed = []
    stack = [(int(root), np.eye(4), 0) for root in reversed(roots)]
    visited = 0
    while stack:
        number, above, depth = stack.pop()
        visited += 1
        if visited > _MOST_NODES or depth > _MOST_DEPTH or not 0 <= number < len(nodes):
            raise FileMalformed(
                "The scene of the GLB file goes in circles, is too deep, or names a lacking node."
            )
        node = nodes[number]
        matrix = above @ _matrix(node)
        if "mesh" in node:
            placed.append((matrix, int(node["mesh"])))
        stack += [(int(child), matrix, depth + 1) for child in reversed(node.get("children", []))]
    return placed


def _matrix(node: dict[str, Any]) -> NDArray[np.float64]:
    """Return a node's own (4, 4) matrix: given column by column, or as translation, rotation and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    x, y, z, w = (float(v) for v in node.get("rotation", (0.0, 0.0, 0.0, 1.0)))
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.array(node.get("scale", (1.0, 1.0, 1.0)), dtype=np.float64)
    matrix[:3, 3] = np.array(node.get("translation", (0.0, 0.0, 0.0)), dtype=np.float64)
    return matrix
