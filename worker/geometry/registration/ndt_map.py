"""The NDT map: space cut into cubes, and a Gaussian of the target's points in each (Magnusson 2009, 6.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from worker.geometry.registration.cell_covariance import CellCovariance, as_run, inverted
from worker.geometry.registration.cell_moments import cell_moments
from worker.geometry.registration.cells import empty_table, fill_table, neighbour_rows, touched_bricks

OUTLIER_RATIO = 0.55
LEAST_POINTS = 6


@dataclass(frozen=True, eq=False)
class NdtMap:
    """Hold C Gaussians and the table that finds those near a point.

    Parameters
    ----------
    resolution : float
        Edge of a cell, the ``ndt_resolution`` [m]. Cells are aligned to multiples of it.
    means : ndarray of shape (C, 3), float64
        Mean of each cell's points [m].
    inverse_covariances : ndarray of shape (C, 6), float64
        xx, xy, xz, yy, yz, zz of each inverse covariance [1/m^2].
    normals : ndarray of shape (C, 3), float64
        Direction in which each cell is thinnest.
    table_keys, table_bricks : ndarrays of shape (S,), int64 and int32
        Open-addressed hash table from a brick's key to its number among B bricks; -1 where free.
    row_starts : ndarray of shape (64 B + 1,), int32
    row_cells : ndarray of shape (L,), int32
        Slot k lists ``row_cells[row_starts[k]:row_starts[k + 1]]``: Gaussians in the 27 cells around.
    """

    resolution: float
    means: NDArray[np.float64]
    inverse_covariances: NDArray[np.float64]
    normals: NDArray[np.float64]
    table_keys: NDArray[np.int64]
    table_bricks: NDArray[np.int32]
    row_starts: NDArray[np.int32]
    row_cells: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.means)

    @property
    def gauss(self) -> tuple[float, float]:
        """Return d1 and d2 of the mixture of a Gaussian and outliers (Magnusson 2009, equation 6.8)."""
        return gauss_constants(self.resolution)


def gauss_constants(resolution: float, *, outlier_ratio: float = OUTLIER_RATIO) -> tuple[float, float]:
    """Return d1 (negative) and d2 of equation 6.8 of Magnusson 2009.

    Parameters
    ----------
    resolution : float
        Edge of a cell [m].
    outlier_ratio : float
        Share of points expected to belong to nothing in the map; PCL's default is 0.55.
    """
    c1 = 10.0 * (1.0 - outlier_ratio)
    c2 = outlier_ratio / resolution**3
    d3 = -math.log(c2)
    d1 = -math.log(c1 + c2) - d3
    d2 = -2.0 * math.log((-math.log(c1 * math.exp(-0.5) + c2) - d3) / d1)
    return d1, d2


def build_ndt_map(
    points: NDArray[np.float64], resolution: float, *, covariance: CellCovariance = "exact"
) -> NdtMap:
    """Return the NDT map of a point cloud; it may have no cell if the points are too few.

    Parameters
    ----------
    points : ndarray of shape (M, 3), float64
        The target [m].
    resolution : float
        Edge of a cell [m].
    covariance : {"exact", "pcl-1.11", "autoware"}
        As PCL from 1.12 on; as PCL up to 1.11, which adds I/n and divides by n instead of n - 1; as Autoware
        Core, which adds I/(n - 1). The identity is in m^2: it drowns walls in cells of few points.

    Raises
    ------
    ValueError
        If the resolution is not positive, or the points reach farther than 2^20 cells from the origin.

    Notes
    -----
    O(M). The exact covariance is that over n - 1; cells of fewer than 6 points are left out as in PCL. A
    cell flatter than 1:100 is thickened to that (equation 6.11), and one without any extent in two directions
    is left out. Unlike PCL, a perfectly flat cell is kept.
    """
    if not (math.isfinite(resolution) and resolution > 0.0):
        msg = f"a cell's edge is positive, not {resolution}"
        raise ValueError(msg)
    moments = cell_moments(points, resolution, least=LEAST_POINTS)
    robots = as_run(moments.covariances, moments.counts, covariance)
    inverses, normals, solid = inverted(robots)
    cells, means = moments.cells, moments.means
    if not solid.all():
        cells, means, inverses, normals = cells[solid], means[solid], inverses[solid], normals[solid]
    bricks = touched_bricks(cells)
    table_keys, table_bricks = empty_table(len(bricks))
    fill_table(bricks, table_keys, table_bricks)
    row_starts, row_cells = neighbour_rows(cells, bricks, table_keys, table_bricks)
    return NdtMap(resolution, means, inverses, normals, table_keys, table_bricks, row_starts, row_cells)
