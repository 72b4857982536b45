"""The surfaces of a bare cloud that a tablet can see: which side they look to is not in the points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from worker.geometry.cloud.voxel_grid import voxel_grid_filter
from worker.geometry.registration.neighbours import NeighbourGrid
from worker.geometry.registration.surfaces import Surfaces, estimate_normals

_STEP = 0.05
_THINNEST, _THICKEST = 0.08, 0.5
_ASIDE = 0.75
_MOST_SPACED = 2_000
COARSE = 0.2
"""Points farther apart than this [m] tell little of a surface's direction and nothing of the tilt."""


def point_spacing(points: NDArray[np.float64]) -> float:
    """Return the usual distance [m] of a cloud's points (N, 3) from their nearest neighbours."""
    if len(points) < 2:
        return 0.0
    some = points[:: 1 + len(points) // _MOST_SPACED]
    nearest, _ = KDTree(points).query(some, k=[2])
    return float(np.median(nearest))


def seen_surfaces(points: NDArray[np.float64], eye: NDArray[np.float64]) -> Surfaces:
    """Return the surfaces of a cloud that look towards a place, without those right behind others.

    A wall is two layers of points. From inside a room the farther one cannot be seen, and a scan that is
    pulled to it comes to lie a wall's thickness off (the paper's failure in -Y, section 4.4).

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
        The cloud near the scan [m]; thinned to 5 cm here.
    eye : ndarray of shape (3,), float64
        Where the tablet was, give or take some decimetres [m].

    Returns
    -------
    Surfaces
        Sided: normals look towards `eye`.

    Notes
    -----
    A point is behind if 8 to 50 cm ahead along its normal there is another, aside by no more than three
    quarters of the usual distance between points. Normals are found anew without those. O(N log N).
    """
    if len(points) < 3:
        return Surfaces(points, np.zeros_like(points), sided=True)
    thinned = voxel_grid_filter(points, _STEP)
    normals, _ = estimate_normals(thinned, towards=eye)
    spacing = point_spacing(thinned)
    grid, aside = NeighbourGrid.with_cells_of_some(thinned), max(_ASIDE * spacing, _STEP)
    behind = np.zeros(len(thinned), dtype=np.bool_)
    for ahead in np.arange(_THINNEST, _THICKEST, min(aside, 2 * _STEP)) + aside:
        left = np.flatnonzero(~behind)
        gap, _ = grid.nearest(thinned[left] + ahead * normals[left], reach=aside)
        behind[left[np.isfinite(gap)]] = True
    front = thinned[~behind]
    normals, _ = estimate_normals(front, towards=eye)
    return Surfaces(front, normals, sided=True, coarse=spacing > COARSE)
