"""Surfaces sampled as points with normals, searched so that a wall's two faces are told apart."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from worker.geometry.registration.neighbours import NeighbourGrid

_SIDE_WEIGHT = 0.5
NEIGHBOURS = 12
"""Points whose spread tells a surface's direction."""


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Hold M points on surfaces with the direction in which each looks.

    Parameters
    ----------
    points : ndarray of shape (M, 3), float64
        In frame `map` [m].
    normals : ndarray of shape (M, 3), float64
        Unit normals; when `sided`, they point away from the solid.
    sided : bool
        Whether the sign of a normal means anything.
    coarse : bool
        Whether the points are so far apart that a scan's own normals are better than these.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    sided: bool
    coarse: bool = False

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def tree(self) -> KDTree:
        """Return a tree over the points."""
        return KDTree(self.points, balanced_tree=False, compact_nodes=False)

    @cached_property
    def grid(self) -> NeighbourGrid:
        """Return the points and normals in a grid."""
        return NeighbourGrid.of(self.points, self.normals)

    def match(
        self, points: NDArray[np.float64], normals: NDArray[np.float64] | None, *, reach: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Return each placed point's distance to the surface near it, its normal, and whether there is one.

        Parameters
        ----------
        points : ndarray of shape (N, 3), float64
            In frame `map` [m].
        normals : ndarray of shape (N, 3) or None
            The scan's own normals towards the tablet, in frame `map`; zero where unknown.
        reach : float
            The sample of the surface may be this far away [m].

        Returns
        -------
        tuple
            Signed distance to the plane of the matched sample (N,) [m], its normal (N, 3), found (N,).
        """
        if self.sided and normals is not None:
            known = np.linalg.norm(normals, axis=1) > 0.5
            most = float(np.hypot(reach, _SIDE_WEIGHT))
            _, index = self.grid.nearest(points, normals, reach=reach, weight=_SIDE_WEIGHT, most=most)
        else:
            known = np.zeros(len(points), dtype=bool)
            _, index = self.grid.nearest(points, reach=reach)
        found = index >= 0
        nearest = np.where(found, index, 0)
        between = points - self.points[nearest]
        matched = self.normals[nearest]
        if self.sided and normals is not None:
            found &= ~known | (np.sum(matched * normals, axis=1) > 0.3)
        if self.coarse and normals is not None:
            matched = np.where(known[:, None], normals, matched)
        return np.sum(between * matched, axis=1), matched, found


def estimate_normals(
    points: NDArray[np.float64], *, towards: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return a unit normal for each point from its 12 nearest neighbours, and whether they are flat.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
        A thinned cloud [m].
    towards : ndarray of shape (3,), optional
        Normals are turned to look towards this place [m].

    Returns
    -------
    tuple
        Normals (N, 3), flat (N,): the neighbours' least extent is under a third of the middle one.
    """
    values, vectors = NeighbourGrid.with_cells_of_some(points).spreads(neighbours=NEIGHBOURS)
    normals = np.ascontiguousarray(vectors[:, :, 0])
    if towards is not None:
        away = np.sum((towards - points) * normals, axis=1) < 0.0
        normals[away] *= -1.0
    flat = values[:, 0] < values[:, 1] / 9.0
    return normals, flat
