"""A scan's surfaces seen coarsely, in any unit: some twenty thousand places, and which way each faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from worker.geometry.cloud.voxel_grid import voxel_index

_ENOUGH = 25_000
_FIRST_SHARE = 1.0 / 250.0
_COARSEN = 1.3
_NEIGHBOURS = 16
_FLAT = 0.15
_MOST_READ = 2_000_000


@dataclass(frozen=True, eq=False)
class SurfaceSample:
    """Hold M places on a scan's surfaces.

    Parameters
    ----------
    points : ndarray of shape (M, 3), float64
        One point of the scan for each voxel, so that a surface counts by its area [unit of the scan].
    normals : ndarray of shape (M, 3), float64
        Unit normals, of either sign.
    flat : ndarray of shape (M,), bool
        Whether the neighbourhood lies in a plane.
    voxel_size : float
        Edge of a voxel [unit of the scan].
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    flat: NDArray[np.bool_]
    voxel_size: float

    @property
    def enough(self) -> bool:
        """Whether there are enough flat places to conclude anything from."""
        return int(self.flat.sum()) >= 150


def sample_surfaces(points: NDArray[np.float64]) -> SurfaceSample:
    """Return a scan's surfaces seen coarsely; nothing random is in it.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
        N >= 1 points in any unit and any axes.

    Notes
    -----
    The voxel is a 250th of the middle extent (between the 1st and 99th percentile), or larger until at most
    25,000 are left. Normals are the direction of least variance of 16 neighbours. About a second.
    """
    some = points[:: max(1, -(-len(points) // _MOST_READ))]
    low, high = np.percentile(some, [1.0, 99.0], axis=0)
    extents = np.sort(high - low)
    voxel_size = float(extents[1] or extents[2]) * _FIRST_SHARE
    if voxel_size <= 0.0:
        flat = np.zeros(1, dtype=np.bool_)
        return SurfaceSample(some[:1], np.array([[0.0, 0.0, 1.0]]), flat, 1.0)
    kept = _thin(some, voxel_size)
    while len(kept) > _ENOUGH:
        voxel_size *= _COARSEN
        kept = _thin(some, voxel_size)
    normals, flat = _normals(kept)
    return SurfaceSample(kept, normals, flat, voxel_size)


def _thin(points: NDArray[np.float64], voxel_size: float) -> NDArray[np.float64]:
    """Return the mean of each voxel's points: less noisy than one of them."""
    index = voxel_index(points - points.min(axis=0), voxel_size)
    widths = index.max(axis=0) + 1
    key = (index[:, 0] * widths[1] + index[:, 1]) * widths[2] + index[:, 2]
    _, group = np.unique(key, return_inverse=True)
    count = np.bincount(group)
    return np.stack([np.bincount(group, weights=points[:, a]) / count for a in range(3)], axis=1)


def _normals(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    if len(points) < _NEIGHBOURS:
        return np.tile([0.0, 0.0, 1.0], (len(points), 1)), np.zeros(len(points), dtype=np.bool_)
    _, near = cKDTree(points).query(points, k=_NEIGHBOURS)
    spread = points[near] - points[near].mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))
    flat = (values[:, 0] < _FLAT * values[:, 1]) & (values[:, 1] > 0.0)
    return np.ascontiguousarray(vectors[:, :, 0]), flat
