"""Scans in every format that is read, written by the formats' own libraries or by hand."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pye57
import trimesh
from numpy.typing import NDArray
from plyfile import PlyData, PlyElement
from pxr import Gf, Usd, UsdGeom, UsdUtils, Vt

from worker.formats.pcd import write_pcd
from worker.geometry.cloud.point_cloud import PointCloud

Points = NDArray[np.float64]

BOX_CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
BOX_TRIANGLES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)  # fmt: skip


def room_points(seed: int, *, count: int = 4_000) -> Points:
    """Return points with millimetre coordinates, so that scaled integers hold them as well."""
    rng = np.random.default_rng(seed)
    return np.round(rng.uniform((-3.0, -2.0, -1.2), (4.0, 3.0, 1.4), (count, 3)), 3)


def ply(path: Path, points: Points, *, text: bool = False, order: str = "<") -> None:
    vertex = np.zeros(len(points), dtype=[("x", "f8"), ("y", "f8"), ("z", "f8")])
    vertex["x"], vertex["y"], vertex["z"] = points.T
    PlyData([PlyElement.describe(vertex, "vertex")], text=text, byte_order="=" if text else order).write(path)


def pcd(path: Path, points: Points) -> None:
    write_pcd(path, PointCloud.of(points))


def las(path: Path, points: Points) -> None:
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales, header.offsets = np.full(3, 0.001), np.round(points.min(axis=0))
    record = laspy.LasData(header)
    record.x, record.y, record.z = points.T
    record.write(path)


def laz(path: Path, points: Points) -> None:
    beside = path.with_suffix(".las")
    las(beside, points)
    laspy.read(beside).write(str(path), do_compress=True, laz_backend=laspy.LazBackend.Lazrs)
    if beside != path:
        beside.unlink()


def e57(path: Path, points: Points) -> None:
    path.unlink(missing_ok=True)
    file = pye57.E57(str(path), mode="w")
    half = len(points) // 2
    turn = np.array([np.cos(0.3), 0.0, 0.0, np.sin(0.3)])
    c, s = np.cos(0.6), np.sin(0.6)
    matrix = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    shift = np.array([1.0, -2.0, 0.5])
    for part, rotation, translation, R, t in (
        (points[:half], np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.eye(3), np.zeros(3)),
        (points[half:], turn, shift, matrix, shift),
    ):
        local = (part - t) @ R
        columns = {f"cartesian{axis}": local[:, k].copy() for k, axis in enumerate("XYZ")}
        file.write_scan_raw(columns, rotation=rotation, translation=translation)
    file.close()


def xyz(path: Path, points: Points) -> None:
    path.write_text("".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in points.tolist()))


def pts(path: Path, points: Points) -> None:
    rows = "".join(f"{x!r} {y!r} {z!r} -1200 10 20 30\r\n" for x, y, z in points.tolist())
    path.write_text(f"{len(points)}\r\n{rows}", newline="")


def csv(path: Path, points: Points) -> None:
    rows = "".join(f"{i},{y!r},{x!r},{z!r}\n" for i, (x, y, z) in enumerate(points.tolist()))
    path.write_text(f"id,Y,X,Z\n{rows}")


def csv_with_decimal_commas(path: Path, points: Points) -> None:
    rows = "".join(f"{x!r};{y!r};{z!r}\n".replace(".", ",") for x, y, z in points.tolist())
    path.write_text(f"x [m];y [m];z [m]\n{rows}")


def cloudcompare(path: Path, points: Points) -> None:
    rows = "".join(f"{x!r} {y!r} {z!r} 1 2 3\n" for x, y, z in points.tolist())
    path.write_text(f"//X Y Z R G B\n{rows}")


def obj_cloud(path: Path, points: Points) -> None:
    path.write_text(
        "# an app\n" + "".join(f"v {x!r} {y!r} {z!r} 0.1 0.2 0.3\n" for x, y, z in points.tolist())
    )


def glb_cloud(path: Path, points: Points) -> None:
    path.write_bytes(trimesh.Scene(trimesh.PointCloud(points)).export(file_type="glb"))


def usdc_cloud(path: Path, points: Points) -> None:
    stage = _stage(path, up="z", metres_per_unit=1.0)
    shape = UsdGeom.Points.Define(stage, "/scan")
    shape.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    stage.Save()
    del stage


CLOUDS: dict[str, Callable[[Path, Points], None]] = {
    "ply": ply,
    "ascii.ply": lambda path, points: ply(path, points, text=True),
    "big.ply": lambda path, points: ply(path, points, order=">"),
    "pcd": pcd, "las": las, "laz": laz, "e57": e57, "xyz": xyz, "pts": pts, "csv": csv,
    "comma.csv": csv_with_decimal_commas, "cc.xyz": cloudcompare, "obj": obj_cloud, "glb": glb_cloud,
    "usdc": usdc_cloud,
}  # fmt: skip
"""What writes a cloud of points, by the file's ending."""


def box_obj(path: Path, size: Points) -> None:
    quads = "f 1/1/1 2/2/2 4 3\nf -4 -2 -1 -3\n"
    rest = "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in BOX_TRIANGLES[4:].tolist())
    corners = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in (BOX_CORNERS * size).tolist())
    path.write_text(f"mtllib none.mtl\no box\n{corners}usemtl grey\n{quads}{rest}")


def _box(size: Points) -> trimesh.Trimesh:
    return trimesh.Trimesh(BOX_CORNERS * size, BOX_TRIANGLES, process=False)


def box_stl(path: Path, size: Points) -> None:
    path.write_bytes(_box(size).export(file_type="stl"))


def box_stl_text(path: Path, size: Points) -> None:
    path.write_text(_box(size).export(file_type="stl_ascii"))


def box_glb(path: Path, size: Points) -> None:
    """Write half the size under a node that doubles it."""
    scene = trimesh.Scene()
    scene.add_geometry(_box(0.5 * size), transform=np.diag([2.0, 2.0, 2.0, 1.0]))
    path.write_bytes(scene.export(file_type="glb"))


def box_ply(path: Path, size: Points) -> None:
    path.write_bytes(_box(size).export(file_type="ply"))


def box_ply_text(path: Path, size: Points) -> None:
    path.write_bytes(_box(size).export(file_type="ply", encoding="ascii"))


def box_ply_quads(path: Path, size: Points) -> None:
    """Write the box as polygons of 3 and of 4 corners, which no fixed record holds."""
    vertex = np.zeros(8, dtype=[("x", "f4"), ("y", "f4"), ("z", "f4")])
    vertex["x"], vertex["y"], vertex["z"] = (BOX_CORNERS * size).T
    lists = [[0, 1, 3, 2], [4, 6, 7, 5], *BOX_TRIANGLES[4:].tolist()]
    face = np.zeros(len(lists), dtype=[("vertex_index", "O")])
    face["vertex_index"] = [np.array(row, dtype="i4") for row in lists]
    elements = [PlyElement.describe(vertex, "vertex"), PlyElement.describe(face, "face")]
    PlyData(elements, byte_order=">").write(path)


def _stage(path: Path, *, up: str | None, metres_per_unit: float | None) -> Usd.Stage:
    stage = Usd.Stage.CreateNew(str(path))
    if up is not None:
        UsdGeom.SetStageUpAxis(stage, up.upper())
    if metres_per_unit is not None:
        UsdGeom.SetStageMetersPerUnit(stage, metres_per_unit)
    return stage


def box_usdc(path: Path, size: Points, *, up: str | None = "y", metres_per_unit: float | None = 0.01) -> None:
    """Write the box in centimetres, a quarter of the size under two nodes that double it."""
    stage = _stage(path, up=up, metres_per_unit=metres_per_unit)
    for name in ("/world", "/world/room"):
        UsdGeom.Xform.Define(stage, name).AddScaleOp().Set(Gf.Vec3f(2.0, 2.0, 2.0))
    mesh = UsdGeom.Mesh.Define(stage, "/world/room/box")
    corners = BOX_CORNERS * size * 0.25 / (metres_per_unit or 1.0)
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(corners.astype(np.float32)))
    mesh.GetFaceVertexCountsAttr().Set([3] * len(BOX_TRIANGLES))
    mesh.GetFaceVertexIndicesAttr().Set(BOX_TRIANGLES.ravel().tolist())
    stage.Save()
    del stage


def box_usdz(path: Path, size: Points) -> None:
    inner = path.with_name("inner.usdc")
    box_usdc(inner, size)
    assert UsdUtils.CreateNewUsdzPackage(str(inner), str(path))
    inner.unlink()


BOXES: dict[str, Callable[[Path, Points], None]] = {
    "obj": box_obj, "stl": box_stl, "ascii.stl": box_stl_text, "glb": box_glb, "ply": box_ply,
    "ascii.ply": box_ply_text, "quads.ply": box_ply_quads, "usdc": box_usdc, "usdz": box_usdz,
}  # fmt: skip
"""What writes the surface of a box of a size in metres, by the file's ending."""


def npy_like_noise(seed: int, size: int) -> bytes:
    return np.random.default_rng(seed).bytes(size)


def stl_header(count: int) -> bytes:
    file = io.BytesIO()
    file.write(bytes(80))
    file.write(struct.pack("<I", count))
    return file.getvalue()
