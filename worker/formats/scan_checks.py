"""Checks that every loader of scans makes before a file's numbers become a scan."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from service.domain.bounds import Bounds
from service.domain.errors import CoordinatesTooLarge, FileEmpty, FileMalformed, NotFinite, TooManyPoints
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.scan.mesh_sampling import Mesh

_FARTHEST = 1e12
"""Largest coordinate, in any unit: a millimetre of the Earth's circumference (4e10) with room to spare."""


def check_count(count: int, *, bounds: Bounds, what: str = "points") -> None:
    """Refuse a promised number of points before anything is allocated for it.

    Raises
    ------
    FileEmpty
        If it is zero.
    TooManyPoints
        If it is above the bound.
    """
    if count <= 0:
        raise FileEmpty(f"The scan holds no {what}.")
    if count > bounds.max_points:
        raise TooManyPoints(
            f"The scan has {count} {what}; at most {bounds.max_points} are read.",
            max_points=bounds.max_points,
        )


def cloud_of(points: NDArray[np.floating]) -> PointCloud:
    """Return points that have a place as a cloud.

    Raises
    ------
    FileEmpty
        If there is none.
    NotFinite, CoordinatesTooLarge
        As `check_places`.
    """
    if not len(points):
        raise FileEmpty("The scan holds no point.")
    check_places(points)
    return PointCloud.of(points)


def mesh_of(vertices: NDArray[np.floating], triangles: NDArray[np.integer], *, bounds: Bounds) -> Mesh:
    """Return a mesh whose triangles point at vertices that have a place, and have some area.

    Raises
    ------
    FileEmpty
        If there is no vertex or no triangle, or no area.
    FileMalformed
        If a triangle points at a vertex that is not there.
    NotFinite, CoordinatesTooLarge
        As `check_places`.
    TooManyPoints
        If there are more vertices, or twice as many triangles, than points are read.
    """
    check_count(len(vertices), bounds=bounds, what="vertices")
    check_count((len(triangles) + 1) // 2, bounds=bounds, what="pairs of triangles")
    check_places(vertices, what="vertices")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise FileMalformed(f"A face of the mesh points outside its {len(vertices)} vertices.")
    mesh = Mesh(np.asarray(vertices, dtype=np.float64), np.asarray(triangles, dtype=np.int64))
    area = float(mesh.areas().sum())
    if not (np.isfinite(area) and area > 0.0):
        raise FileEmpty("The faces of the mesh have no area: there is no surface to take points from.")
    return mesh


def check_places(points: NDArray[np.floating], *, what: str = "points") -> None:
    """Refuse (N, 3) coordinates that are no places.

    Raises
    ------
    NotFinite
        If a coordinate is NaN or infinite.
    CoordinatesTooLarge
        If one is beyond 10^12 units.
    """
    bad = int(np.count_nonzero(~np.isfinite(points).all(axis=1)))
    if bad:
        raise NotFinite(
            f"{bad} of {len(points)} {what} have coordinates that are not finite numbers.", points=bad
        )
    far = int(np.count_nonzero((np.abs(points) > _FARTHEST).any(axis=1)))
    if far:
        raise CoordinatesTooLarge(
            f"{far} of {len(points)} {what} have coordinates beyond {_FARTHEST:g}, which are no places: the "
            "file is damaged. Export it again.",
            points=far,
        )
