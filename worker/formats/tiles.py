"""A map's cloud cut into square tiles, as Autoware's divided point cloud map (`autoware_map_loader`).

Autoware takes a map's pieces by the names of their files and never looks at a name twice: a tile that
changed needs a new name. So a tile is named by its own SHA-256, and what did not change keeps name and bytes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from worker.formats.pcd import pcd_bytes
from worker.geometry.cloud.point_cloud import PointCloud

TILE_SIZE_M = 20
"""Edge of a tile; whole metres, since Autoware reads corners as integers."""

_FOLDER = "tiles"


@dataclass(frozen=True)
class Tile:
    """Hold a tile as it was written.

    Parameters
    ----------
    path : str
        Relative to the revision's files: ``tiles/<sha256>.pcd``.
    corner : tuple of int
        Its smallest x and y in frame `map` [m], multiples of the tile's edge.
    points : int
        How many it holds, at least 1.
    """

    path: str
    sha256: str
    size_bytes: int
    corner: tuple[int, int]
    points: int

    def to_json(self) -> dict[str, Any]:
        """Return the tile as a JSON object."""
        return {
            "path": self.path,
            "sha256": self.sha256,
            "size_bytes": self.size_bytes,
            "corner_m": list(self.corner),
            "points": self.points,
        }


def in_tile_order(cloud: PointCloud) -> PointCloud:
    """Return the cloud tile by tile: by the tile's y, then its x; inside a tile in the order given.

    The records of the tiles, one tile after the other, are then the records of the whole cloud: a file
    rebuilt from tiles is the file, bit for bit. And a change in one place leaves long runs of bytes as they
    were, which is what makes deltas small.
    """
    index = _tile_index(cloud.points)
    if not len(index):
        return cloud
    index -= index.min(axis=0)
    place = index[:, 1] * (index[:, 0].max() + 1) + index[:, 0]
    if place.max() <= np.iinfo(np.uint16).max:
        place = place.astype(np.uint16)  # which NumPy sorts by counting, in linear time
    order = np.argsort(place, kind="stable")
    return PointCloud(cloud.points[order], cloud.labels[order])


def write_tiles(directory: Path, cloud: PointCloud) -> list[Tile]:
    """Write each tile as ``tiles/<sha256>.pcd`` and return them in the order of the cloud's points.

    Parameters
    ----------
    directory : Path
        Exists; ``tiles/`` is made in it, and an earlier map's tiles there are removed: a loader takes
        every tile that it finds.
    cloud : PointCloud
        In frame `map`, as `in_tile_order` gives it.

    Raises
    ------
    ValueError
        If the points do not lie tile by tile.
    """
    folder = directory / _FOLDER
    folder.mkdir(exist_ok=True)
    for earlier in folder.glob("*.pcd"):
        earlier.unlink()
    index = _tile_index(cloud.points)
    starts = np.flatnonzero(np.append(True, (np.diff(index, axis=0) != 0).any(axis=1))[: len(index)])
    corners = [(int(x) * TILE_SIZE_M, int(y) * TILE_SIZE_M) for x, y in index[starts]]
    if corners != sorted(set(corners), key=lambda corner: (corner[1], corner[0])):
        msg = "the points of a divided cloud lie tile by tile: by y, then by x"
        raise ValueError(msg)
    ends = np.append(starts, len(cloud))[1:]
    return [
        _write_tile(folder, PointCloud(cloud.points[a:b], cloud.labels[a:b]), corner)
        for a, b, corner in zip(starts, ends, corners, strict=True)
    ]


def write_autoware(directory: Path, tiles: Sequence[Tile]) -> list[Path]:
    """Write ``pointcloud_map_metadata.yaml`` and ``map_projector_info.yaml`` and return their paths.

    Notes
    -----
    The loader finds a tile by the name of its file, without its folder, and reads the corners as integers:
    https://autowarefoundation.github.io/autoware_core/latest/map/autoware_map_loader/. The frame `map` is
    local: it is tied to no place on the globe.
    """
    metadata, projector = directory / "pointcloud_map_metadata.yaml", directory / "map_projector_info.yaml"
    lines = [f"x_resolution: {TILE_SIZE_M:.1f}", f"y_resolution: {TILE_SIZE_M:.1f}"]
    lines += [f"{Path(tile.path).name}: [{tile.corner[0]}, {tile.corner[1]}]" for tile in tiles]
    metadata.write_text("\n".join(lines) + "\n", encoding="utf-8")
    projector.write_text("projector_type: Local\n", encoding="utf-8")
    return [metadata, projector]


def _tile_index(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the (N, 2) tile of each point as the files hold it, which is in float32."""
    written = points[:, :2].astype(np.float32).astype(np.float64)
    return np.floor(written / TILE_SIZE_M).astype(np.int64)


def _write_tile(folder: Path, cloud: PointCloud, corner: tuple[int, int]) -> Tile:
    content = pcd_bytes(cloud)
    sha256 = hashlib.sha256(content).hexdigest()
    (folder / f"{sha256}.pcd").write_bytes(content)
    return Tile(f"{_FOLDER}/{sha256}.pcd", sha256, len(content), corner, len(cloud))
