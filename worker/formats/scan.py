"""Scans of any kind that is read here, told apart by their own bytes, in the file's axes or upright."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from service.domain.bounds import Bounds
from service.domain.formats import E57, GLB, LAS, OBJ, PCD, PLY, STL, USD, USDZ, XYZ, Media, Purpose
from service.domain.media import HEAD_BYTES, accept
from service.domain.scan_options import ScanOptions
from worker.formats.glb import load_glb
from worker.formats.mesh import load_obj, load_stl
from worker.formats.pcd import read_pcd
from worker.formats.ply_faces import load_ply
from worker.formats.scan_process import load_apart
from worker.formats.xyz import load_xyz
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.scan.file_scan import FileScan
from worker.geometry.scan.upright import UprightScan, make_upright


def load_scan(path: Path, bounds: Bounds | None = None) -> FileScan:
    """Return the points or the mesh of a scan, whatever its name says, in the file's own unit and axes.

    Parameters
    ----------
    path : Path
        A file of a format that is taken as a scan (`service.domain.formats`).
    bounds : Bounds, optional
        The most points to read; for LAS, E57 and USD also the most memory and time.

    Raises
    ------
    UnsupportedMedia
        If the bytes begin like none of them.
    FileEmpty
        If the file has no bytes, or no point.
    Rejected
        As the kind's loader does.
    """
    path, bounds = Path(path), bounds or Bounds()
    with path.open("rb") as file:
        found = accept(file.read(HEAD_BYTES), Purpose.SCAN)
    return LOADERS[found](path, bounds=bounds)


def _load_pcd(path: Path, *, bounds: Bounds) -> FileScan:
    return FileScan(read_pcd(path, bounds), "PCD")


LOADERS: Mapping[Media, Callable[..., FileScan]] = {
    PLY: load_ply,
    PCD: _load_pcd,
    XYZ: load_xyz,
    OBJ: load_obj,
    STL: load_stl,
    LAS: partial(load_apart, "las"),
    E57: partial(load_apart, "e57"),
    GLB: load_glb,
    USD: partial(load_apart, "usd"),
    USDZ: partial(load_apart, "usd"),
}


def read_scan(path: Path, bounds: Bounds | None = None, *, options: ScanOptions | None = None) -> PointCloud:
    """Return a scan's points in frame `scan`: the file's own axes, in metres, in the file's order.

    A placement's ``T_map_scan`` takes these very coordinates to the map. A file in metres comes back bit by
    bit, whichever of its axes is up; one in another unit is scaled, a mesh sampled, and one that lies more
    than 10 km off its origin moved near by the origin that its `ScanFrame` tells.

    Parameters
    ----------
    path : Path
        The file, of any kind that `load_scan` reads.
    bounds : Bounds, optional
        The most points to read.
    options : ScanOptions, optional
        The up axis and the unit, where a person gave them.

    Returns
    -------
    PointCloud
        N >= 1 points.

    Raises
    ------
    Rejected
        As `load_scan` does.
    """
    return read_upright_scan(path, bounds, options=options).scan


def read_upright_scan(
    path: Path, bounds: Bounds | None = None, *, options: ScanOptions | None = None
) -> UprightScan:
    """Return a scan in frame `scan`, with the turn that makes it upright and why it was chosen.

    Who places a scan places its ``cloud`` (frame `upright`: z up, levelled) and tells
    ``T_map_scan = T_map_upright @ frame.T_upright_scan``: that holds for what `read_scan` returns.

    Parameters
    ----------
    path : Path
        The file, of any kind that `load_scan` reads.
    bounds : Bounds, optional
        The most points to read.
    options : ScanOptions, optional
        The up axis and the unit, where a person gave them.

    Raises
    ------
    Rejected
        As `load_scan` does.
    """
    return make_upright(load_scan(path, bounds), options)


def read_map_points(path: Path, bounds: Bounds | None = None) -> PointCloud:
    """Return the points of a file that is in frame `map` already: its numbers are taken as metres, z up.

    Raises
    ------
    Rejected
        As `load_scan` does.
    """
    return load_scan(path, bounds).cloud(1.0)
