"""USD scenes (USDZ, USDC, USDA), as Apple's room and object capture write them, read by Pixar's library."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Ar, Tf, Usd, UsdGeom

from service.domain.bounds import Bounds
from service.domain.errors import FileEmpty, FileMalformed, FileTruncated
from worker.formats.mesh import fan
from worker.formats.scan_checks import check_count, cloud_of, mesh_of
from worker.formats.scratch import scratch_folder
from worker.formats.usd_layers import MOST_PARTS, check_parts, own_layers
from worker.geometry.scan.file_scan import FileScan, Statement

_NAMES = ((b"PK\x03\x04", ".usdz"), (b"PXR-USDC", ".usdc"), (b"#usda", ".usda"))
_TRAILER = b"PK\x05\x06"


def load_usd(path: Path, *, bounds: Bounds) -> FileScan:
    """Return the meshes of a USD scene in its world, or its points where it has no mesh.

    Raises
    ------
    FileTruncated
        If a USDZ ends before its table of contents.
    FileMalformed
        If the file breaks the format.
    FileEmpty, TooManyPoints, NotFinite
        As for every scan.

    Notes
    -----
    ``upAxis`` and ``metersPerUnit`` are taken from the stage where the file holds them; USD's fallbacks (y
    and centimetres) are not taken for statements. Files that the scene refers to are never opened.
    """
    with path.open("rb") as file:
        head = file.read(8)
        file.seek(max(0, path.stat().st_size - 66_000))
        whole = _TRAILER in file.read()
    suffix = next((name for start, name in _NAMES if head.startswith(start)), ".usda")
    if suffix == ".usdz" and not whole:
        raise FileTruncated("The USDZ file ends before its table of contents: it is cut short.")
    with scratch_folder("groundplan-usd-") as folder:
        named = folder / f"scan{suffix}"
        named.symlink_to(path.resolve())
        try:
            Ar.SetPreferredResolver("ArDefaultResolver")
            layers = own_layers(str(named))
            check_parts(layers)
            stage = Usd.Stage.Open(layers[0], Usd.Stage.LoadNone)
            return _read(stage, bounds=bounds)
        except Tf.ErrorException as error:
            raise FileMalformed(f"The USD file breaks its format: {str(error).strip()[-160:]}.") from error


def _read(stage: Any, *, bounds: Bounds) -> FileScan:
    world = UsdGeom.XformCache(Usd.TimeCode.EarliestTime())
    vertices, triangles, clouds, before = [], [], [], 0
    for number, prim in enumerate(stage.Traverse(Usd.TraverseInstanceProxies())):
        if number >= MOST_PARTS:
            raise FileMalformed(f"The USD scene has more than the {MOST_PARTS} parts that are read.")
        if not prim.IsA(UsdGeom.PointBased):
            continue
        points = _placed(UsdGeom.PointBased(prim), world)
        if prim.IsA(UsdGeom.Mesh) and len(points):
            triangles.append(_triangles(UsdGeom.Mesh(prim), len(points)) + before)
            vertices.append(points)
            before += len(points)
            check_count(before, bounds=bounds, what="vertices")
        elif prim.IsA(UsdGeom.Points):
            clouds.append(points)
    statement = _statement(stage)
    if vertices:
        return FileScan(mesh_of(np.vstack(vertices), np.vstack(triangles), bounds=bounds), "USD", statement)
    if clouds:
        check_count(sum(len(cloud) for cloud in clouds), bounds=bounds)
        return FileScan(cloud_of(np.vstack(clouds)), "USD", statement)
    raise FileEmpty("The USD scene holds neither a mesh nor points.")


def _placed(shape: Any, world: Any) -> NDArray[np.float64]:
    """Return a shape's points in the scene's world; USD's matrices take row vectors."""
    raw = shape.GetPointsAttr().Get(Usd.TimeCode.EarliestTime())
    points = np.asarray(raw if raw is not None else [], dtype=np.float64).reshape(-1, 3)
    matrix = np.array(world.GetLocalToWorldTransform(shape.GetPrim()), dtype=np.float64)
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(points @ matrix[:3, :3] + matrix[3, :3])


def _triangles(mesh: Any, points: int) -> NDArray[np.int64]:
    at = Usd.TimeCode.EarliestTime()
    counts, corners = mesh.GetFaceVertexCountsAttr().Get(at), mesh.GetFaceVertexIndicesAttr().Get(at)
    if counts is None or corners is None:
        return np.zeros((0, 3), dtype=np.int64)
    triangles = fan(np.asarray(counts, dtype=np.int64), np.asarray(corners, dtype=np.int64))
    if triangles.size and not 0 <= triangles.min() <= triangles.max() < points:
        raise FileMalformed(f"A face of the USD scene points outside its {points} vertices.")
    return triangles


def _statement(stage: Any) -> Statement:
    up = str(UsdGeom.GetStageUpAxis(stage)).lower() if stage.HasAuthoredMetadata("upAxis") else None
    authored = UsdGeom.StageHasAuthoredMetersPerUnit(stage)
    unit = float(UsdGeom.GetStageMetersPerUnit(stage)) if authored else None
    if unit is not None and not 1e-6 <= unit <= 1e4:
        unit = None
    said = [f"upAxis is {up}"] if up else []
    said += [f"metersPerUnit is {unit:g}"] if unit else []
    return Statement(up, unit, f"The file says: {', '.join(said)}." if said else "")
