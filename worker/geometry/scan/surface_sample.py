"""A scan's surfaces seen coarsely, in any unit: some twenty thousand places, and which way each faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from worker.geometry.cloud.places import row_keys, smallest_that_fits
from worker.geometry.cloud.voxel_grid import voxel_index

_ENOUGH = 25_000
_FIRST_SHARE = 1.0 / 250.0
_COARSEN = 1.3
_NEIGHBOURS = 16
_FLAT = 0.15
_MOST_READ = 2_000_000
_FINEST_SHARE = 2.0**-40


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
    25,000 are left; it is never so small that a voxel could not be numbered. Normals are the direction of
    least variance of 16 neighbours. About a second.
    """
    some = points[:: max(1, -(-len(points) // _MOST_READ))]
    low, high = np.percentile(some, [1.0, 99.0], axis=0)
    extents = np.sort(high - low)
    finest = max(
        float(extents[1] or extents[2]) * _FIRST_SHARE, float(np.ptp(some, axis=0).max()) * _FINEST_SHARE
    )
    if finest <= 0.0 or extents[2] <= 0.0:
        flat = np.zeros(1, dtype=np.bool_)
        return SurfaceSample(some[:1], np.array([[0.0, 0.0, 1.0]]), flat, 1.0)
    near = some - some.min(axis=0)
    step = smallest_that_fits(
        lambda k: len(np.unique(row_keys(voxel_index(near, finest * _COARSEN**k)))), _ENOUGH
    )
    voxel_size = finest * _COARSEN**step
    kept = _thin(some, voxel_index(near, voxel_size))
    normals, flat = _normals(kept)
    return SurfaceSample(kept, normals, flat, voxel_size)


def _thin(points: NDArray[np.float64], index: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the mean of the points of each voxel, less noisy than one of them, ordered by the voxels."""
    _, first, group = np.unique(row_keys(index), return_index=True, return_inverse=True)
    count = np.bincount(group)
    means = np.stack([np.bincount(group, weights=points[:, a]) / count for a in range(3)], axis=1)
    return np.asarray(means[np.lexsort(index[first].T[::-1])], dtype=np.float64)


def _normals(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    if len(points) < _NEIGHBOURS:
        return np.tile([0.0, 0.0, 1.0], (len(points), 1)), np.zeros(len(points), dtype=np.bool_)
    _, near = cKDTree(points).query(points, k=_NEIGHBOURS)
    spread = points[near] - points[near].mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))
    flat = (values[:, 0] < _FLAT * values[:, 1]) & (values[:, 1] > 0.0)
    return np.ascontiguousarray(vectors[:, :, 0]), flat
